"""Load cells of two axes whose gains are not alike."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter


@dataclass(frozen=True)
class AxisGain(Effect):
    """Forces along y are read 1 + g times as large as they are, in proportion to those along x."""

    name = "axis gain"
    stage = "load"
    of_rig = True
    formula = "f_y / (1 + g)"
    amplitudes = (Parameter("g", "1", lower=-0.5, upper=1.0, typical=0.05),)
    decided_by = "one weight on both load cells, or the sheet turned by 90 degrees"

    def missing(self, data):
        return None if data.biaxial else "forces along two axes"

    def loads(self, data, loads, a, shape):
        return loads / jnp.stack([jnp.ones_like(a[0]), 1.0 + a[0]])[:, None]
