"""Covariance of the parameters of a network, as a model file holds it, and the standard deviations that follow from it.

In: a factor of the covariance. Out: standard deviations of whatever is linear in d psi / dI, to first order in the parameters.
How the covariance is found is in `calibrate.fitting.uncertainty`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.models import pann

Array = NDArray[np.float64]
Z95 = 1.959963984540054  # standard deviations on either side: 95 % of a normal distribution
MISFIT = 1.5  # reduced chi-square above which the residuals are no longer taken for noise


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """factor (n_parameters, k): covariance of the parameters = factor factor^T.

    effective_parameters: trace of (J^T J + a)^-1 J^T J, see `calibrate.fitting.uncertainty`.
    reduced_chi_square: loss / (equations - effective parameters) of the network as fitted, before its stiffness was raised for noise; of
    arbitrary level where the noise is unknown. What a report calls so is that of the model as it is (`Calibration`).
    """

    factor: Array
    effective_parameters: float
    reduced_chi_square: float
    noise_is_known: bool

    @property
    def covariance(self) -> Array:
        """(n_parameters, n_parameters)."""
        return self.factor @ self.factor.T

    @property
    def scale(self) -> float:
        """What the covariance was multiplied by."""
        return max(1.0, self.reduced_chi_square) if self.noise_is_known else self.reduced_chi_square

    @property
    def is_lower_bound(self) -> bool:
        """Whether noise does not explain the residuals, or may not: then part of them is an error of the model."""
        return not self.noise_is_known or self.reduced_chi_square > MISFIT

    def deviation(self, architecture: pann.Architecture, parameters: Array, invariants: Array, weights: Array) -> Array:
        """Standard deviation (...) of sum_k weights_k d psi / dI_k at invariants, weights (..., 2), to first order;
        in the unit of the energy where the weights have none."""
        slopes = values_and_slopes(architecture, parameters, invariants)[1]
        return np.linalg.norm(np.einsum("...kp,...k->...p", slopes, weights) @ self.factor, axis=-1)

    def to_dict(self) -> dict[str, Any]:
        """Content for a model file; `from_dict` reads it."""
        return {
            "factor": self.factor.tolist(),
            "effective_parameters": self.effective_parameters,
            "reduced_chi_square": self.reduced_chi_square,
            "noise_is_known": self.noise_is_known,
        }

    @classmethod
    def from_dict(cls, content: dict[str, Any], n_parameters: int) -> Uncertainty:
        """From the content of a model file. Raises KeyError, TypeError or ValueError."""
        factor = np.asarray(content["factor"], float)
        numbers = float(content["effective_parameters"]), float(content["reduced_chi_square"])
        if factor.ndim != 2 or len(factor) != n_parameters or not np.isfinite(factor).all():
            raise ValueError(f"uncertainty: factor must be {n_parameters} rows of finite numbers")
        if not all(0 <= number < np.inf for number in numbers):
            raise ValueError("uncertainty: effective_parameters and reduced_chi_square must be finite, not negative")
        return cls(factor, *numbers, bool(content["noise_is_known"]))


def values_and_slopes(architecture: pann.Architecture, parameters: Array, invariants: Array) -> tuple[Array, Array]:
    """d psi / d(I1, I2) (..., 2) at invariants (..., 2), and its derivative (..., 2, n_parameters) by the parameters."""
    a, shape = architecture, np.shape(invariants)
    flat, theta = jnp.asarray(invariants).reshape(-1, 2), jnp.asarray(parameters)
    found = _values_and_slopes(a.inputs, tuple(a.layers), jnp.asarray(a.scales), a.energy_scale, theta, flat)
    return np.asarray(found[0]).reshape(shape), np.asarray(found[1]).reshape(*shape, -1)


@partial(jax.jit, static_argnums=(0, 1))
def _values_and_slopes(inputs, layers, scales, energy_scale, parameters, invariants):
    """Compiled once for each size of network, whatever its scales."""
    architecture = pann.Architecture(inputs, layers, (scales[0], scales[1]), energy_scale)
    value = lambda p: pann.energy_derivatives(architecture, p, invariants)  # noqa: E731
    return value(parameters), jax.jacfwd(value)(parameters)
