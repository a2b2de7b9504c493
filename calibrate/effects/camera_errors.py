"""What a camera and its correlation may get wrong: lens, distance, smoothing, the strip at the edge, the scale."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from calibrate.effects.borders import subset_moments
from calibrate.effects.effect import Effect, Parameter, lacks_plane_stress
from calibrate.effects.nodal_derivatives import gradient, second_derivatives
from calibrate.equations.tensors import det, inverse

NEWTON = 4  # steps


@dataclass(frozen=True)
class LensDistortion(Effect):
    """Radial: a point at x from the middle of the picture is seen at x (1 + k |x|^2 / R^2), R half the extent.

    Both pictures are distorted; the true places are found exactly, and R from those of the reference. With A the gradient
    of the true by the seen reference points, the true deformation gradient is F A^-1, F that of the true places by the
    seen points, and P turns into det A P A^-T (Piola transformation).
    """

    name = "lens distortion"
    stage = "measurement"
    formula = "x (1 + k |x|^2 / R^2)"
    source = "Brown 1971"
    amplitudes = (Parameter("k", "1", typical=0.005),)
    decided_by = "pictures of a dot grid"

    def missing(self, data):
        return lacks_plane_stress(data)

    def displacements(self, data, u, a, shape):
        X = data.points - centre(data)
        return undistorted(X + u, a[0], radius(data, a[0])) - X

    def stress(self, data, F, P, a, shape, law):
        X, R = data.centroids - centre(data), radius(data, a[0])
        s, q = shrinkage(X, a[0], R)
        slope = -2.0 * a[0] / R**2 * s**3 / (1.0 + 3.0 * q * s**2) * X  # of s
        A = s[:, :, None] * jnp.eye(2) + X[:, :, None] * slope[:, None, :]
        back = inverse(A)
        full = jax.vmap(law)((F @ back).reshape(-1, 2, 2)).reshape(F.shape)
        plain = jax.vmap(law)(F.reshape(-1, 2, 2)).reshape(F.shape)
        seen = det(A)[:, None, None] * full @ jnp.swapaxes(back, -1, -2)
        return P + seen - plain


def centre(data):
    """Middle (2,) of the specimen, mm."""
    return 0.5 * (data.points.min(axis=0) + data.points.max(axis=0))


def undistorted(x, k, R):
    """True places (..., 2), mm, from the middle, of what is seen at x (..., 2)."""
    return shrinkage(x, k, R)[0] * x


def shrinkage(x, k, R):
    """s (..., 1) with s + q s^3 = 1, so that s x is seen at x, and q = k |x|^2 / R^2."""
    q = k * jnp.sum(x * x, axis=-1, keepdims=True) / R**2
    s = jnp.ones_like(q)
    for _ in range(NEWTON):
        s = s - (s + q * s**3 - 1.0) / (1.0 + 3.0 * q * s**2)
    return s, q


def radius(data, k):
    """Half the true extent, mm."""
    X, R = data.points - centre(data), 0.5 * data.size
    for _ in range(NEWTON):
        R = 0.5 * jnp.ptp(undistorted(X, k, R), axis=0).max()
    return R


@dataclass(frozen=True)
class OutOfPlane(Effect):
    """The specimen comes nearer to the camera as it is loaded, so that the picture grows by m at the end."""

    name = "out-of-plane motion"
    stage = "measurement"
    formula = "x (1 + m s), s: share of the loading"
    source = "Sutton, Yan, Tiwari, Schreier and Orteu 2008"
    amplitudes = (Parameter("m", "1", typical=0.003),)
    decided_by = "a second camera, or a telecentric lens"

    def displacements(self, data, u, a, shape):
        size = jnp.sqrt((data.u**2).mean(axis=(1, 2)))
        share = (size / size.max())[:, None, None]
        X = data.points - centre(data)
        return u - a[0] * share / (1.0 + a[0] * share) * (X + u)


@dataclass(frozen=True)
class SubsetSmoothing(Effect):
    """A displacement is read at the middle of a plane fitted over a subset; s2 is the variance of the subset's weights.

    Inside, measured = u + s2 lap(u) / 2. At an edge, which cuts off part of a square of `side`, the plane misreads a
    quadratic field by another tensor of moments, even of the other sign (`calibrate.effects.borders`). The square is that
    of variance s2 = side^2 / 12; `side` stands for it where s2 is not known yet. Second order in s2.
    """

    name = "subset smoothing"
    stage = "measurement"
    truncated = True
    formula = "u + s2 M : grad grad u / 2, M: moments of a square cut by edges"
    source = "Schreier and Sutton 2002"
    amplitudes = (Parameter("s2", "mm^2", lower=0.0, typical=1.0),)
    shapes = (Parameter("side", "mm", lower=0.0),)
    shapes_vary = False
    decided_by = "the same pictures correlated with smaller subsets"
    rough = True

    def shape_values(self, data):
        pitch = float(jnp.sqrt(2.0 * jnp.median(data.areas)))
        return [(4 * pitch,), (2 * pitch,), (pitch,), (0.5 * pitch,)]

    def displacements(self, data, u, a, shape):
        known = a[0] > 0
        side = jnp.where(known, jnp.sqrt(12.0 * jnp.where(known, a[0], 1.0)), shape[0])
        moments = subset_moments(data.lines, side)

        def change(u):
            return 0.5 * a[0] * jnp.einsum("nij,tncij->tnc", moments, second_derivatives(data, u))

        return u - change(u - change(u))


@dataclass(frozen=True)
class UnmeasuredStrip(Effect):
    """A strip of width w between the measured region and the true free edge carries load, too.

    Its deformation gradient is continued in a straight line from that at the centroid and at the edge of the triangle
    beside it to the middle of the strip; a strip around a hole of radius 1 / q is shorter than the edge by w q / 2.
    """

    name = "unmeasured strip"
    stage = "measurement"
    truncated = True
    formula = "area + w (1 - w q / 2) edge length at free edges"
    amplitudes = (Parameter("w", "mm", lower=0.0, typical=0.5),)
    decided_by = "a picture that shows the edge"

    def missing(self, data):
        return lacks_plane_stress(data)

    def stress(self, data, F, P, a, shape, law):
        w, there = a[0], (data.edges > 0)[:, None, None]
        at_nodes = gradient(data, data.u)
        at_edge = jnp.eye(2) + at_nodes[:, data.edge_nodes].mean(axis=2)
        beyond = jnp.where(there, F + (at_edge - F) * (1.0 + 0.75 * w * data.edges)[:, None, None], F)
        both = [jax.vmap(law)(f.reshape(-1, 2, 2)).reshape(F.shape) for f in (beyond, F)]
        share = w * data.edges * (1.0 - 0.5 * w * data.lines[data.edge_nodes, 0, 3].mean(axis=1))
        return P + share[:, None, None] * (P + both[0] - both[1])


@dataclass(frozen=True)
class Scale(Effect):
    """Lengths in the picture are wrong by one factor."""

    name = "DIC scale"
    stage = "measurement"
    formula = "x (1 + e)"
    amplitudes = (Parameter("e", "1", typical=0.02),)
    gauge = "a common factor of modulus, force, thickness and DIC scale"

    def loads(self, data, loads, a, shape):
        return loads * (1.0 + a[0])
