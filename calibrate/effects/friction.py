"""Friction between the load cell and the sheet, as of the guides of a grip."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter
from calibrate.effects.force_offset import largest_direction


@dataclass(frozen=True)
class Friction(Effect):
    """Every load cell reads more than the sheet has while its displacements grow, and less while they fall (Coulomb); at rest as before.

    Of the difference R0 is there at every load, as of a seal; R1 at the largest force, in proportion to what is read, as of a guide that the load presses on.
    """

    name = "friction in the load train"
    stage = "load"
    of_rig = True
    formula = "f - s (R0 e + R1 f / f_max), s: sign of the motion, e: direction of the largest force f_max"
    amplitudes = (Parameter("R0", "N", lower=0.0, typical=0.1), Parameter("R1", "N", lower=0.0, typical=0.1))
    decided_by = "cycles without a specimen, or of a spring"

    def missing(self, data):
        return None if float(data.motion_sign.min()) < 0 else "a way back"

    def loads(self, data, loads, a, shape):
        largest = jnp.sqrt(jnp.sum(loads * loads, axis=1)).max(axis=0)
        share = loads / jnp.where(largest > 0, largest, 1.0)
        return loads - data.motion_sign[:, None, None] * (a[0] * largest_direction(loads) + a[1] * share)
