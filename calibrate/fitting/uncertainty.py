r"""Uncertainty of a calibrated network: covariance of its parameters, standard deviations of what it predicts.

In: the whitened, reduced loss |R c - d|^2 (`Quadratic`, rows of unit variance), the fitted network c(theta).
Out: `Uncertainty`. With J = R dc/dtheta and the precision a of the normal prior that the fit itself used
(`network_fit.PRIOR_STD`), the covariance of the parameters is that of

    exp(-(|R c - d|^2 + a |theta|^2) / (2 scale)),        c linearised at the fit,        weights >= 0

(`bounded_normal`); away from the bounds it is scale (J^T J + a)^-1.
scale = loss / (equations - effective parameters), at least 1 where the noise is known; effective parameters
= trace of (J^T J + a)^-1 J^T J. It holds noise and what the data leave undetermined, not an error of the model.

The factor by which the fit corrects its stiffness (`Quadratic.stiffness_factor`, s) leaves this as it is: the loss at the
corrected network is s times larger, while the information on the stiffness, F^T W F, is s times smaller than J^T J says
for the fitted one, because noise in G adds to it; both cancel relative to the stress.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrate.equations.basis import Basis
from calibrate.equations.inputs import REFERENCE
from calibrate.equations.reduction import Quadratic
from calibrate.fitting import network_fit
from calibrate.fitting.bounded_normal import bounded_factor
from calibrate.models import pann
from calibrate.models.parameter_covariance import Uncertainty, values_and_slopes

Array = NDArray[np.float64]


def parameter_uncertainty(
    quadratic: Quadratic, architecture: pann.Architecture, parameters: Array, noise_is_known: bool
) -> Uncertainty:
    """Uncertainty of a network fitted to `quadratic` by `network_fit.fit_network`.

    architecture: as fitted, before its energy was multiplied by the stiffness factor. In plane strain the bulk modulus is
    unknown, too, and whatever it is allowed for.
    """
    quadratic = quadratic.of_energy()
    R, d = quadratic.factor()
    c, slopes = coefficients_and_slopes(architecture, quadratic.basis, parameters)
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
    slopes = coefficients_and_slopes(architecture, energy, parameters)[1]
    own, shared = quadratic.Q[-1, -1], quadratic.Q[:-1, -1] @ slopes @ found.factor
    return float(np.sqrt(found.scale / own + (shared**2).sum() / own**2))


def prior_precision(quadratic: Quadratic, d: Array) -> float:
    """1 / variance of the prior of `network_fit.fit_network` on every parameter, in units of the whitened loss."""
    explained = float(d @ d)
    floor = max(quadratic.constant - explained, 0.0)
    return floor / max(quadratic.n_rows, 1) / network_fit.PRIOR_STD**2 + 1e-14 * explained


def coefficients_and_slopes(architecture: pann.Architecture, basis: Basis, parameters: Array) -> tuple[Array, Array]:
    """Spline coefficients (n_functions,) of a network and their derivative (n_functions, n_parameters)."""
    inputs = np.nan_to_num(basis.site_inputs) + REFERENCE
    invariants = np.stack([inputs[:, 0], inputs[:, 1] ** (2 / 3)], axis=1)
    values, slopes = values_and_slopes(architecture, parameters, invariants)
    to_inputs = np.stack([np.ones(len(inputs)), 1.5 * np.sqrt(invariants[:, 1])], axis=1)  # dI2 to d I2^(3/2)
    values, slopes = values / to_inputs, slopes / to_inputs[:, :, None]
    return basis.interpolation @ values.ravel(), basis.interpolation @ slopes.reshape(-1, len(parameters))
