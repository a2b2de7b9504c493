r"""Uncertainty of a calibrated network: covariance of its parameters, standard deviations of what it predicts.

In: the whitened, reduced loss |R c - d|^2 (`Quadratic`, rows of unit variance), the fitted network c(theta).
Out: `Uncertainty`. With J = R dc/dtheta and the precision a of the normal prior that the fit itself used
(`fit.PRIOR_STD`), the covariance of the parameters is that of

    exp(-(|R c - d|^2 + a |theta|^2) / (2 scale)),        c linearised at the fit,        weights >= 0

(`bounded_normal`); away from the bounds it is scale (J^T J + a)^-1.
scale = loss / (equations - effective parameters), at least 1 where the noise is known; effective parameters
= trace of (J^T J + a)^-1 J^T J. It holds noise and what the data leave undetermined, not an error of the model.

The factor by which the fit corrects its stiffness (`Quadratic.stiffness_factor`, s) leaves this as it is: the loss at the
corrected network is s times larger, while the information on the stiffness, F^T W F, is s times smaller than J^T J says
for the fitted one, because noise in G adds to it; both cancel relative to the stress.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.equations.basis import Basis
from calibrate.equations.reduction import Quadratic
from calibrate.fitting import network_fit
from calibrate.fitting.bounded_normal import bounded_factor
from calibrate.models import pann

Array = NDArray[np.float64]
BAND = 1.959963984540054  # standard deviations on either side: 95 % of a normal distribution
MISFIT = 1.5  # reduced chi-square above which the residuals are no longer taken for noise


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """factor (n_parameters, k): covariance of the parameters = factor factor^T.

    effective_parameters: how many directions of the parameters the data fix.
    reduced_chi_square: loss / (equations - effective parameters); of arbitrary level where the noise is unknown.
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


def parameter_uncertainty(
    quadratic: Quadratic, architecture: pann.Architecture, parameters: Array, noise_is_known: bool
) -> Uncertainty:
    """Uncertainty of a network fitted to `quadratic` by `fit.fit_network`.

    architecture: as fitted, before its energy was multiplied by the stiffness factor. In plane strain the bulk modulus is
    unknown, too, and whatever it is allowed for.
    """
    quadratic = quadratic.of_energy()
    R, d = quadratic.factor()
    c, slopes = _coefficients_and_slopes(architecture, quadratic.basis, parameters)
    residual, J, prior = R @ c - d, R @ slopes, prior_precision(quadratic, d)
    information = np.linalg.svd(J, compute_uv=False) ** 2
    effective = float((information / (information + prior)).sum())
    loss = max(float(residual @ residual) + quadratic.constant - float(d @ d), 0.0)
    chi_square = loss / max(quadratic.n_rows - effective, 1.0)
    scale = max(1.0 if noise_is_known else 1e-12, chi_square)
    gradient = J.T @ residual + prior * parameters
    factor = bounded_factor(
        J / np.sqrt(scale), prior / scale, gradient / scale, np.asarray(parameters), architecture.nonnegative
    )
    return Uncertainty(factor, effective, chi_square, noise_is_known)


def bulk_modulus_deviation(
    quadratic: Quadratic, architecture: pann.Architecture, parameters: Array, found: Uncertainty
) -> float:
    """Standard deviation, MPa (or N/mm), of the bulk modulus that belongs to a network in plane strain; arguments as
    above."""
    energy = quadratic.of_energy().basis
    slopes = _coefficients_and_slopes(architecture, energy, parameters)[1]
    own, shared = quadratic.Q[-1, -1], quadratic.Q[:-1, -1] @ slopes @ found.factor
    return float(np.sqrt(found.scale / own + (shared**2).sum() / own**2))


def prior_precision(quadratic: Quadratic, d: Array) -> float:
    """1 / variance of the prior of `fit.fit_network` on every parameter, in units of the whitened loss."""
    explained = float(d @ d)
    floor = max(quadratic.constant - explained, 0.0)
    return floor / max(quadratic.n_rows, 1) / network_fit.PRIOR_STD**2 + 1e-14 * explained


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


def _coefficients_and_slopes(architecture: pann.Architecture, basis: Basis, parameters: Array) -> tuple[Array, Array]:
    """Spline coefficients (n_functions,) of a network and their derivative (n_functions, n_parameters)."""
    inputs = np.nan_to_num(basis.site_inputs) + pann.REFERENCE
    invariants = np.stack([inputs[:, 0], inputs[:, 1] ** (2 / 3)], axis=1)
    values, slopes = values_and_slopes(architecture, parameters, invariants)
    to_inputs = np.stack([np.ones(len(inputs)), 1.5 * np.sqrt(invariants[:, 1])], axis=1)  # dI2 to d I2^(3/2)
    values, slopes = values / to_inputs, slopes / to_inputs[:, :, None]
    return basis.interpolation @ values.ravel(), basis.interpolation @ slopes.reshape(-1, len(parameters))
