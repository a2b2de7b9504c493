"""Fibres: one family in a direction, or two mirrored about an axis; standard reinforcement (Qiu and Pence 1997)."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from calibrate.effects.effect import Effect, Parameter

ANGLES = 12
CLOSED = 0.1  # rad between a family and the axis, below which two are one
ANGLE = Parameter("angle", "rad", lower=-np.pi, upper=np.pi)


@dataclass(frozen=True)
class OneFibreFamily(Effect):
    """P gains 2 k (I4 - 1) F M x M with I4 = |F M|^2 and M at `angle` to x."""

    name = "one fibre family"
    stage = "energy"
    of_material = True
    formula = "psi + k / 2 (I4 - 1)^2, I4 = |F M|^2"
    source = "Qiu and Pence 1997"
    amplitudes = (Parameter("k", "MPa", lower=0.0, typical=0.02),)
    shapes = (ANGLE,)
    decided_by = "the same sheet cut and pulled in another direction"

    def shape_values(self, data):
        return [(float(angle),) for angle in np.arange(ANGLES) * np.pi / ANGLES]

    def stress(self, data, F, P, a, shape):
        return P + a[0] * reinforcement(F, shape[0])

    def stress_formed(self, data, F, formed, a, shape):
        return a[0] * reinforcement(F, shape[0], formed)


@dataclass(frozen=True)
class TwoFibreFamilies(Effect):
    """Two families at `axis` +- `half`, of equal stiffness."""

    name = "two fibre families"
    stage = "energy"
    of_material = True
    formula = "psi + k / 2 sum (I4 - 1)^2 of two directions"
    source = "Qiu and Pence 1997"
    amplitudes = (Parameter("k", "MPa", lower=0.0, typical=0.02),)
    shapes = (Parameter("axis", "rad"), Parameter("half", "rad", lower=0.0, upper=np.pi / 4))
    decided_by = "the same sheet cut and pulled in two other directions"

    def shape_values(self, data):
        return [
            (float(axis), float(half)) for axis in np.arange(-4, 4) * np.pi / 8 for half in np.arange(1, 5) * np.pi / 16
        ]

    def is_degenerate(self, shape):
        return shape[1] < CLOSED

    def stress(self, data, F, P, a, shape):
        return P + self.stress_formed(data, F, None, a, shape)

    def stress_formed(self, data, F, formed, a, shape):
        both = (reinforcement(F, shape[0] + sign * shape[1], formed) for sign in (1, -1))
        return a[0] * sum(both)


def reinforcement(F, angle, formed=None):
    """d/dF of (I4 - 1)^2 / 2 for fibres at `angle`, rad, to x: (..., 2, 2) at F (..., 2, 2).

    formed (..., 2, 2): deformation at which they are straight and free of stress, along the same line of the material.
    """
    M = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    FM = F @ M
    rest = 1.0 if formed is None else jnp.sum((formed @ M) ** 2, axis=-1)
    I4 = jnp.sum(FM * FM, axis=-1) / rest
    return 2.0 * (((I4 - 1.0) / rest)[..., None] * FM)[..., :, None] * M
