"""Radial distortion of a lens about its centre of distortion, exact, with the strain that the reference picture is distorted by."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from calibrate.effects.effect import Effect, Parameter, lacks_plane_stress

NEWTON = 4  # steps
FOLDED = -4 / 27  # k r^2 / R^2, at which a picture has no place for what is farther out
TRIED = (
    (0.0, 0.0),
    (-0.15, 0.0),
    (0.15, 0.0),
    (0.0, -0.15),
    (0.0, 0.15),
)  # centres: the signature is nearly linear in them


@dataclass(frozen=True)
class LensDistortion(Effect):
    """A point at x is seen at c + (x - c) (1 + k |x - c|^2 / R^2), R half the extent of the specimen, c the centre of distortion.

    The specimen need not be in the middle of the picture, nor that on the axis of the lens: c has two shapes. Both pictures are distorted; the
    true places are found exactly, and R from those of the reference.
    """

    name = "lens distortion"
    stage = "lens"
    of_rig = True
    formula = "c + (x - c) (1 + k |x - c|^2 / R^2)"
    source = "Brown 1971"
    amplitudes = (Parameter("k", "1", lower=-0.2, upper=0.2, typical=0.005),)
    shapes = (
        Parameter("x", "extent", lower=-0.5, upper=0.5, typical=0.1, may_be_zero=True),
        Parameter("y", "extent", lower=-0.5, upper=0.5, typical=0.1, may_be_zero=True),
    )
    former_shape = (0.0, 0.0)
    decided_by = "pictures of a dot grid"

    def missing(self, data):
        return lacks_plane_stress(data)

    def shape_values(self, data):
        return list(TRIED)

    def is_possible(self, data, a, shape):
        far = float(jnp.sum((data.points - centre(data, shape)) ** 2, axis=-1).max())
        return a[0] * far / (0.5 * float(data.size)) ** 2 > FOLDED

    def located(self, data, shape):
        x, y = np.asarray(data.centre) + float(data.size) * np.array(shape)
        return f"about ({x:.3g}, {y:.3g}) mm"

    def displacements(self, data, u, a, shape):
        from_centre = data.points - centre(data, shape)
        return undistorted(from_centre + u, a[0], radius(data, a[0], shape)) - from_centre

    def places(self, data, X, a, shape):
        c = centre(data, shape)
        return c + undistorted(X - c, a[0], radius(data, a[0], shape))


def centre(data, shape):
    """Of distortion (2,), mm, by its place from the middle of the specimen over the extent."""
    return data.centre + data.size * jnp.stack([shape[0], shape[1]])


def undistorted(x, k, R):
    """True places (..., 2), mm, from the centre, of what is seen at x (..., 2): s x with s + k |x|^2 / R^2 s^3 = 1."""
    q = k * jnp.sum(x * x, axis=-1, keepdims=True) / R**2
    s = jnp.ones_like(q)
    for _ in range(NEWTON):
        s = s - (s + q * s**3 - 1.0) / (1.0 + 3.0 * q * s**2)
    return s * x


def radius(data, k, shape):
    """Half the true extent, mm."""
    X, R = data.points - centre(data, shape), 0.5 * data.size
    for _ in range(NEWTON):
        R = 0.5 * jnp.ptp(undistorted(X, k, R), axis=0).max()
    return R
