"""Mullins softening: softer below the largest deformation so far; seen in unloading only."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
from jax.scipy.special import erf

from calibrate.effects.effect import Effect, Parameter
from calibrate.effects.support.largest_deformation import excess, lacks_unloading

SHARPEST = 0.01  # beta, nearly none, which Ogden and Roxburgh have; without m and beta a step, on which no finite-element solution converges
LINEAR = (0.0, 100.0)  # m and beta of a softening that is linear in x / x_max, within 2e-5 of r


@dataclass(frozen=True)
class Mullins(Effect):
    """P times 1 - r erf((x_max - x) / (m + beta x_max)) / erf(1 / beta), x = I1 - 3: softer the further below its largest deformation.

    The form is that of Ogden and Roxburgh (1999; beta: Mars 2004) with x in the place of the energy, as it is for a neo-Hookean sheet. r: of a place that was much
    deformed (x_max far above m) and is unloaded. A large beta makes it linear, 1 - r (1 - x / x_max).
    """

    name = "Mullins softening"
    stage = "softening"
    of_material = True
    formula = "P (1 - r erf((x_max - x) / (m + beta x_max)) / erf(1 / beta)), x = I1 - 3"
    source = "Mullins 1969; Ogden and Roxburgh 1999"
    amplitudes = (Parameter("r", "1", lower=0.0, upper=1.0, typical=0.2),)
    shapes = (Parameter("m", "1", lower=0.0, upper=5.0), Parameter("beta", "1", lower=SHARPEST, upper=LINEAR[1]))
    former_shape = LINEAR
    decided_by = "unloading and reloading"

    def missing(self, data):
        return lacks_unloading(data)

    def shape_values(self, data):
        return [(0.001, 3.0), (0.02, 0.1), (0.2, 0.1)]

    def stress(self, data, F, P, a, shape):
        value, largest = excess(F)
        m, beta = shape
        below = (largest - value) / (m + beta * jnp.maximum(largest, 1e-9))
        return P * (1.0 - a[0] * erf(below) / erf(1.0 / beta))[..., None, None]
