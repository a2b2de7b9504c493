"""Which invariants the data of a calibration reach: equations in, ranges of I1 and I2 out."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.kinematics import INVARIANTS, invariants_and_derivatives

QUANTILE = 0.999
WEAK_SIGNAL, WEAK_QUANTILE = 3.0, 0.9  # signal to noise of the strain, below which the range ends earlier


def calibrated_range(
    system: Equilibrium, increments: NDArray[np.bool_] | None = None, quantile: float = QUANTILE
) -> dict[str, tuple[float, float]]:
    """Range of I1 and I2 in the data: from rest to the area-weighted `quantile` over the increments (None: all).

    Of a strain near its noise a lower quantile: the last thousandth of the area is noise.
    """
    if system.experiment.strain_signal.ratio < WEAK_SIGNAL:
        quantile = min(quantile, WEAK_QUANTILE)
    F = system.isochoric_gradients if increments is None else system.isochoric_gradients[increments]
    values = np.asarray(invariants_and_derivatives(jnp.asarray(F))[0])
    weights = np.broadcast_to(system.areas, values.shape[:2]).ravel()
    result = {}
    for i, name in enumerate(INVARIANTS):
        flat = values[..., i].ravel()
        order = np.argsort(flat)
        share = np.cumsum(weights[order]) / weights.sum()
        index = min(int(np.searchsorted(share, quantile)), len(order) - 1)
        result[name] = (3.0, float(flat[order[index]]))
    return result
