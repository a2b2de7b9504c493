"""Classical laws in plane strain fitted to the equations of a calibration with its weights, and the time that takes.

In: a calibration. Out: parameters of `calibrate.fitting.classical_fit.fit_law`. The weights are those of the calibration's last spline, made anew, as
a law that is fitted by itself has to make them; what noise adds to the squares is not taken off.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from beside.published_laws import Law
from numpy.typing import NDArray

from calibrate.equations.reduction import assemble
from calibrate.equations.weights import Weights
from calibrate.fitting.calibration import Calibration
from calibrate.fitting.classical_fit import fit_law

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


def weights_made_anew(calibration: Calibration) -> Weights:
    """Of the equations, at the last spline."""
    assert calibration.spline is not None
    return assemble(calibration.system, calibration.basis).weights(calibration.spline)


def fit(law: Law, calibration: Calibration, weighting: Weights) -> ClassicalFit:
    """Parameters of least weighted residual. Raises `RuntimeError` where least squares do not converge."""
    start = time.process_time()
    found = fit_law(law, calibration.system, weighting, np.array(law.start))
    if not found.reason.is_success:
        raise RuntimeError(f"{law.name}: {found.reason.message}")
    freedom = found.equations - len(found.parameters)
    return ClassicalFit(law, found.parameters, found.chi_square / freedom, time.process_time() - start)
