"""Mullins softening: softer below the largest deformation so far; seen in unloading only."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter
from calibrate.effects.support.largest_deformation import excess, lacks_unloading


@dataclass(frozen=True)
class Mullins(Effect):
    """P times 1 - r (1 - x / x_max), x = I1 - 3: softer the further below its largest deformation."""

    name = "Mullins softening"
    stage = "softening"
    of_material = True
    formula = "P (1 - r (1 - x / x_max)), x = I1 - 3"
    source = "Mullins 1969"
    amplitudes = (Parameter("r", "1", lower=0.0, upper=1.0, typical=0.2),)
    decided_by = "unloading and reloading"

    def missing(self, data):
        return lacks_unloading(data)

    def stress(self, data, F, P, a, shape):
        value, largest = excess(F)
        return P * (1.0 - a[0] * (1.0 - value / jnp.maximum(largest, 1e-9)))[..., None, None]
