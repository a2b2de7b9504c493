"""How good is a calibrated model: comparison with a known truth in the three homogeneous modes.

In: a Model and the truth as d psi / d(I1, I2). Out: relative mean stress bias and r2 of the nominal stress in
uniaxial, equi-biaxial and pure-shear tension, up to the stretch where I1 reaches a given limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.equations.deformation_modes import MODES, Derivatives, largest_stretch, nominal_stress
from calibrate.models.network_model import Model
from forward.materials import Material

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ArrudaBoyceTruth:
    """d psi / d(I1, I2) (..., 2), MPa, of the five-term Arruda-Boyce energy (Steinmann et al. 2012, Arch. Appl. Mech.)."""

    mu: float = 0.2698
    N: float = 21.49

    def __call__(self, invariants: Array) -> Array:
        c = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)
        I1 = invariants[..., 0]
        slope = self.mu * sum((k + 1) * c[k] / self.N**k * I1**k for k in range(5))
        return np.stack([slope, np.zeros_like(slope)], axis=-1)


@dataclass(frozen=True)
class MaterialDerivatives:
    """d psi / d(I1, I2) (..., 2) of a material of the forward model, by automatic differentiation of its energy, in the energy's unit."""

    material: Material

    def __call__(self, invariants: Array) -> Array:
        slopes = jax.vmap(jax.grad(lambda pair: jnp.asarray(self.material.energy(pair[0], pair[1]))))
        return np.asarray(slopes(jnp.asarray(invariants).reshape(-1, 2))).reshape(np.shape(invariants))


@dataclass(frozen=True)
class Agreement:
    """bias: mean stress error relative to the mean stress; r2: coefficient of determination; max_error: relative
    to the largest stress."""

    mode: str
    stretch: float  # where the comparison ends
    bias: float
    r2: float
    max_error: float


def agreement(model: Model, truth: Derivatives, I1: float, start: float = 3.0, n: int = 200) -> list[Agreement]:
    """Compare on `n` equidistant stretches of each mode, from first invariant `start` to `I1`."""
    result = []
    for mode in MODES:
        stretch = np.linspace(largest_stretch(mode, start), largest_stretch(mode, I1), n)
        expected, found = nominal_stress(truth, mode, stretch), model.homogeneous(mode, stretch)
        result.append(
            Agreement(
                mode,
                float(stretch[-1]),
                float((found - expected).sum() / expected.sum()),
                r2(expected, found),
                float(np.abs(found - expected).max() / expected.max()),
            )
        )
    return result


def relative_rms_error(expected: Array, found: Array) -> float:
    """Root mean square of found - expected over that of expected."""
    return float(np.sqrt(np.mean((found - expected) ** 2) / np.mean(expected**2)))


def r2(expected: Array, found: Array) -> float:
    """Coefficient of determination 1 - sum (found - expected)^2 / sum (expected - mean)^2."""
    return float(1 - ((found - expected) ** 2).sum() / ((expected - expected.mean()) ** 2).sum())
