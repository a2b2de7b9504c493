"""Classical laws fitted to stress-stretch curves with the weights of the network's fit, and how much worse each is.

In: curves and the network fitted to them (`sobolev_fit`). Out: `Comparison`, as of a full-field test. The noise of a curve is not stated, so
that chi-squares are over that of the best candidate.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibrate.fitting.classical_fit import AT_REST, ClassicalFit, Comparison, least_squares_fit, ranked
from calibrate.fitting.homogeneous.sobolev_fit import Curves, SupervisedFit, gradients
from calibrate.models.classical_laws import CLASSICAL_LAWS, Law

Array = NDArray[np.float64]


def compare_curves(curves: Curves, network: SupervisedFit, laws: Sequence[Law] = CLASSICAL_LAWS) -> Comparison:
    """Every law against the network on the same points with the same weights."""
    F, stress, weight = gradients(curves)
    model = network.model
    own = weight * (model.nominal_stress(F)[:, 0, 0] - stress)
    mu = float(2 * model.derivatives(np.array([[3.0, 3.0]])).sum())
    tops = (model.calibrated_range["I1"][1], model.calibrated_range["I2"][1])
    fits = [_fitted(law, F, stress, weight, max(mu, 1e-6), tops) for law in laws]
    return ranked(
        float(own @ own), min(network.effective_parameters, len(stress) - 1.0), fits, len(stress), known=False,
        loads=float((weight * stress) @ (weight * stress)),
    )  # fmt: skip


def _fitted(law: Law, F: Array, stress: Array, weight: Array, mu: float, tops: tuple[float, float]) -> ClassicalFit:
    def evaluated(p: Array) -> tuple[Array, Array]:
        P, slopes = law.stress_and_sensitivity(F, p)
        return weight * (P[:, 0, 0] - stress), (weight * slopes[..., 0, 0]).T

    found = least_squares_fit(evaluated, len(stress), law.start(mu, tops[0] - 2), law.lower)
    share = law.stability(found.parameters, tops) / abs(law.stability(found.parameters, AT_REST))
    return ClassicalFit(law, found, share)
