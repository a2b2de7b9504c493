"""Payne softening: stiffer where the sheet was never much deformed; seen in unloading only."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter
from calibrate.effects.support.largest_deformation import excess, lacks_unloading


@dataclass(frozen=True)
class Payne(Effect):
    """P times 1 + r exp(-x_max / x0): stiffer where it was never much deformed."""

    name = "Payne softening"
    stage = "softening"
    of_material = True
    formula = "P (1 + r exp(-x_max / x0)), x = I1 - 3"
    source = "Payne 1962"
    amplitudes = (Parameter("r", "1", lower=0.0, typical=0.3),)
    shapes = (Parameter("x0", "1", lower=0.0),)
    decided_by = "cycles of small amplitude before and after a large one"

    def missing(self, data):
        return lacks_unloading(data)

    def shape_values(self, data):
        return [(0.02,), (0.1,), (0.5,)]

    def stress(self, data, F, P, a, shape):
        return P * (1.0 + a[0] * jnp.exp(-excess(F)[1] / shape[0]))[..., None, None]
