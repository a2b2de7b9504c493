"""A camera whose axis is not perpendicular to the sheet, so that one side of the picture is seen larger than the other."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter, lacks_plane_stress


@dataclass(frozen=True)
class CameraTilt(Effect):
    """A point at x from the middle is seen at x / (1 + t . x / R), R half the extent of the specimen in the picture.

    Of a pinhole camera at the distance D, turned by theta against the normal of the sheet, t is R tan(theta) / D in the direction in which the sheet
    recedes. Both pictures are seen so; the true places are found exactly. One factor cos(theta) along t is left out: 0.1 % at 3 degrees, the same everywhere, it is
    nearly a scale.
    """

    name = "camera tilt"
    stage = "perspective"
    of_rig = True
    formula = "x / (1 + t . x / R)"
    source = "Lava, Coppieters, Wang, Van Houtte and Debruyne 2011"
    amplitudes = (
        Parameter("tx", "1", lower=-0.1, upper=0.1, typical=0.003),
        Parameter("ty", "1", lower=-0.1, upper=0.1, typical=0.003),
    )
    decided_by = "a second camera, or pictures of a dot grid in the plane of the sheet"

    def missing(self, data):
        return lacks_plane_stress(data)

    def excluded(self, data):
        return data.reference_height is not None  # two cameras measure it

    def displacements(self, data, u, a, shape):
        from_middle = data.points - data.centre
        return _true(data, from_middle + u, a) - from_middle

    def places(self, data, X, a, shape):
        return data.centre + _true(data, X - data.centre, a)


def _true(data, x, a):
    """Places (..., 2), mm, from the middle, of what is seen at x (..., 2)."""
    t = jnp.stack([a[0], a[1]])
    return x / (1.0 - jnp.sum(x * t, axis=-1, keepdims=True) / (0.5 * data.size))
