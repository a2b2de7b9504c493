"""What a camera and its correlation may get wrong: lens, distance, smoothing, the strip at the edge, the scale."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter
from calibrate.effects.recovery import laplacian


@dataclass(frozen=True)
class LensDistortion(Effect):
    """Radial: a point at x from the middle of the picture is seen at x (1 + k |x|^2 / R^2), R half the extent.

    Both pictures are distorted. With A the gradient of the true by the seen reference points, the true deformation
    gradient is F A^-1, F that of the true places by the seen points, and P turns into det A P A^-T (Piola transformation).
    """

    name = "lens distortion"
    stage = "measurement"
    formula = "x (1 + k |x|^2 / R^2)"
    amplitudes = (Parameter("k", "1", typical=0.005),)
    decided_by = "pictures of a dot grid"

    def displacements(self, data, u, a, shape):
        X = data.points - centre(data)
        return u - a[0] * excess(data, X + u)

    def stress(self, data, F, P, a, shape, law):
        X = data.centroids - centre(data)
        A = jnp.eye(2) - a[0] * jax.vmap(jax.jacfwd(lambda x: excess(data, x)))(X)
        inverse = jnp.linalg.inv(A)
        full = jax.vmap(law)((F @ inverse).reshape(-1, 2, 2)).reshape(F.shape)
        plain = jax.vmap(law)(F.reshape(-1, 2, 2)).reshape(F.shape)
        seen = jnp.linalg.det(A)[:, None, None] * full @ jnp.swapaxes(inverse, -1, -2)
        return P + seen - plain


def centre(data):
    """Middle (2,) of the specimen, mm."""
    return 0.5 * (data.points.min(axis=0) + data.points.max(axis=0))


def excess(data, x):
    """x |x|^2 / R^2 (..., 2), mm, of places x (..., 2) from the middle."""
    return x * jnp.sum(x * x, axis=-1, keepdims=True) / (0.5 * data.size) ** 2


@dataclass(frozen=True)
class OutOfPlane(Effect):
    """The specimen comes nearer to the camera as it is loaded, so that the picture grows by m at the end."""

    name = "out-of-plane motion"
    stage = "measurement"
    formula = "x (1 + m s), s: share of the loading"
    amplitudes = (Parameter("m", "1", typical=0.003),)
    decided_by = "a second camera, or a telecentric lens"

    def displacements(self, data, u, a, shape):
        size = jnp.sqrt((data.u**2).mean(axis=(1, 2)))
        share = (size / size.max())[:, None, None]
        return u - a[0] * share * (data.points - centre(data) + u)


@dataclass(frozen=True)
class SubsetSmoothing(Effect):
    """Displacements are means over a subset: measured = u + s2 lap(u) / 2, s2 the variance of the subset's weights."""

    name = "subset smoothing"
    stage = "measurement"
    formula = "u + s2 lap(u) / 2"
    amplitudes = (Parameter("s2", "mm^2", lower=0.0, typical=1.0),)
    decided_by = "the same pictures correlated with smaller subsets"

    def displacements(self, data, u, a, shape):
        return u - 0.5 * a[0] * laplacian(data, u)


@dataclass(frozen=True)
class UnmeasuredStrip(Effect):
    """A strip of width w between the measured region and the true free edge carries load as its neighbours do."""

    name = "unmeasured strip"
    stage = "measurement"
    formula = "area + w edge length at free edges"
    amplitudes = (Parameter("w", "mm", lower=0.0, typical=0.5),)
    decided_by = "a picture that shows the edge"

    def stress(self, data, F, P, a, shape, law):
        return P * (1.0 + a[0] * data.edges)[:, None, None]


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
