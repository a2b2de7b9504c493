"""Fibres: one family in a direction, or two mirrored about an axis, that stiffen by an exponential (Holzapfel, Gasser and Ogden 2000); without it
(k2 = 0) the standard reinforcement (Qiu and Pence 1997). They act in tension and in compression."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from calibrate.effects.effect import Effect, Parameter
from calibrate.effects.support.nodal_derivatives import law_gradients

ANGLES = 12
CLOSED = 0.1  # rad between a family and the axis, below which two are one
ANGLE = Parameter("angle", "rad", lower=-np.pi, upper=np.pi)
STIFFENING = Parameter("k2", "1", lower=0.0, upper=50.0)
START = 0.1  # of k2 E^2 at the largest strain E of the test, from which a fit goes on
SOURCE = "Qiu and Pence 1997; Holzapfel, Gasser and Ogden 2000"


@dataclass(frozen=True)
class OneFibreFamily(Effect):
    """P gains 2 k E exp(k2 E^2) F M x M with E = I4 - 1, I4 = |F M|^2 and M at `angle` to x."""

    name = "one fibre family"
    stage = "energy"
    of_material = True
    formula = "psi + k / (2 k2) (exp(k2 (I4 - 1)^2) - 1), I4 = |F M|^2"
    source = SOURCE
    amplitudes = (Parameter("k", "MPa", lower=0.0, typical=0.02),)
    shapes = (ANGLE, STIFFENING)
    former_shape = (0.0,)
    nested_in = "two fibre families"
    decided_by = "the same sheet cut and pulled in another direction"

    def shape_values(self, data):
        k2 = first_stiffening(data)
        return [(float(angle), k2) for angle in np.arange(ANGLES) * np.pi / ANGLES]

    def stress(self, data, F, P, a, shape):
        return P + a[0] * reinforcement(F, shape[0], shape[1])

    def stress_formed(self, data, F, formed, a, shape):
        return a[0] * reinforcement(F, shape[0], shape[1], formed)


@dataclass(frozen=True)
class TwoFibreFamilies(Effect):
    """Two families at `axis` +- `half`, of equal stiffness."""

    name = "two fibre families"
    stage = "energy"
    of_material = True
    formula = "psi + k / (2 k2) sum (exp(k2 (I4 - 1)^2) - 1) of two directions"
    source = SOURCE
    amplitudes = (Parameter("k", "MPa", lower=0.0, typical=0.02),)
    shapes = (Parameter("axis", "rad"), Parameter("half", "rad", lower=0.0, upper=np.pi / 4), STIFFENING)
    former_shape = (0.0,)
    decided_by = "the same sheet cut and pulled in two other directions"

    def shape_values(self, data):
        k2 = first_stiffening(data)
        return [
            (float(axis), float(half), k2)
            for axis in np.arange(-4, 4) * np.pi / 8
            for half in np.arange(1, 5) * np.pi / 16
        ]

    def is_degenerate(self, shape):
        return shape[1] < CLOSED

    def stress(self, data, F, P, a, shape):
        return P + self.stress_formed(data, F, None, a, shape)

    def stress_formed(self, data, F, formed, a, shape):
        both = (reinforcement(F, shape[0] + sign * shape[1], shape[2], formed) for sign in (1, -1))
        return a[0] * sum(both)


def first_stiffening(data) -> float:
    """k2 that is tried. Of the strain the mean over the sheet counts in each direction, as noise makes single triangles large."""
    mean = np.asarray(law_gradients(data, data.u)).mean(axis=1)
    largest = float(np.linalg.svd(mean, compute_uv=False).max()) ** 2 - 1
    return float(np.clip(START / largest**2, 0.01, 10.0)) if largest > 0 else START


def reinforcement(F, angle, k2, formed=None):
    """d/dF of (exp(k2 (I4 - 1)^2) - 1) / (2 k2) for fibres at `angle`, rad, to x: (..., 2, 2) at F (..., 2, 2).

    formed (..., 2, 2): deformation at which they are straight and free of stress, along the same line of the material.
    """
    M = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    FM = F @ M
    rest = 1.0 if formed is None else jnp.sum((formed @ M) ** 2, axis=-1)
    E = jnp.sum(FM * FM, axis=-1) / rest - 1.0
    return 2.0 * ((E * jnp.exp(k2 * E**2) / rest)[..., None] * FM)[..., :, None] * M
