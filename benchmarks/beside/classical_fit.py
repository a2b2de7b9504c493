"""Classical laws fitted to the same equations with the same weights as the network.

In: a calibration. Out: parameters of least squares of the whitened residual of the virtual-work equations (Levenberg-Marquardt with
exact derivatives). The weights are those of the calibration's last pass; what noise adds to the squares is not taken off.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from beside.published_laws import Law
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calibrate.equations.reduction import assemble
from calibrate.equations.weights import Weights, weights_of
from calibrate.fitting.calibration import Calibration

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ClassicalFit:
    """parameters of a law; chi-square a degree of freedom; CPU time of the fit alone, s."""

    law: Law
    parameters: Array
    reduced_chi_square: float
    cpu_seconds: float

    def stress(self, F: Array) -> Array:
        """P (..., 2, 2) at F (..., 2, 2)."""
        return self.law.stress(F, self.parameters)


def weights(calibration: Calibration) -> Weights:
    """Those of the last pass of a calibration."""
    assert calibration.spline is not None
    assembled = assemble(calibration.system, calibration.basis)
    covariances = list(assembled.noise_covariances(calibration.spline))
    return weights_of(covariances, np.isfinite(calibration.system.loads))


def fit(law: Law, calibration: Calibration, weighting: Weights) -> ClassicalFit:
    """Parameters of least weighted residual. Raises `RuntimeError` where least squares do not converge."""
    system = calibration.system
    loads, F = np.nan_to_num(system.loads), system.deformation_gradients

    def residual(p: Array) -> Array:
        return weighting(system.internal_forces(law.stress(F, p)) - loads)

    def derivative(p: Array) -> Array:
        return weighting(system.internal_forces(law.sensitivity(F, p))).T

    start = time.process_time()
    found = least_squares(residual, np.array(law.start), derivative, method="lm", x_scale="jac")
    if not found.success:
        raise RuntimeError(f"{law.name}: {found.message}")
    freedom = weighting.size - len(found.x)
    return ClassicalFit(law, found.x, float(2 * found.cost / freedom), time.process_time() - start)
