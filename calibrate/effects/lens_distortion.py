"""Radial distortion of a lens, exact, with the strain that the reference picture is distorted by."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter, lacks_plane_stress

NEWTON = 4  # steps


@dataclass(frozen=True)
class LensDistortion(Effect):
    """Radial: a point at x from the middle of the picture is seen at x (1 + k |x|^2 / R^2), R half the extent.

    Both pictures are distorted; the true places are found exactly, and R from those of the reference.
    """

    name = "lens distortion"
    stage = "lens"
    of_rig = True
    formula = "x (1 + k |x|^2 / R^2)"
    source = "Brown 1971"
    amplitudes = (Parameter("k", "1", lower=-0.2, upper=0.2, typical=0.005),)
    decided_by = "pictures of a dot grid"

    def missing(self, data):
        return lacks_plane_stress(data)

    def displacements(self, data, u, a, shape):
        X = data.points - data.centre
        return undistorted(X + u, a[0], radius(data, a[0])) - X

    def places(self, data, X, a, shape):
        return data.centre + undistorted(X - data.centre, a[0], radius(data, a[0]))


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
    X, R = data.points - data.centre, 0.5 * data.size
    for _ in range(NEWTON):
        R = 0.5 * jnp.ptp(undistorted(X, k, R), axis=0).max()
    return R
