"""Which invariants the data of a calibration reach: equations in, ranges of I1 and I2 out."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.kinematics import INVARIANTS, invariants_and_derivatives

Array = NDArray[np.float64]
QUANTILE = 0.999
WEAK_SIGNAL, WEAK_QUANTILE = 3.0, 0.9  # signal to noise of the strain, below which the range ends earlier


def calibrated_range(
    system: Equilibrium, increments: NDArray[np.bool_] | None = None, quantile: float = QUANTILE
) -> dict[str, tuple[float, float]]:
    """Range of I1 and I2 in the data: from rest to the area-weighted `quantile` over the increments (None: all).

    Of a strain near its noise a lower quantile: the last thousandth of the area is noise.
    """
    F = system.isochoric_gradients if increments is None else system.isochoric_gradients[increments]
    values = np.asarray(invariants_and_derivatives(jnp.asarray(F))[0])
    return {name: (3.0, _largest(system, values[..., i], quantile)) for i, name in enumerate(INVARIANTS)}


def largest_fibre_stretch(
    system: Equilibrium, increments: NDArray[np.bool_], angle: float, quantile: float = QUANTILE
) -> float:
    """The same of I4 = |F M|^2 with M at an angle, rad, to x."""
    M = np.array([np.cos(angle), np.sin(angle)])
    return _largest(system, ((system.deformation_gradients[increments] @ M) ** 2).sum(axis=-1), quantile)


def _largest(system: Equilibrium, values: Array, quantile: float) -> float:
    """Area-weighted quantile of values (k, m) of the triangles in some increments; of a strain near its noise a lower one."""
    if system.experiment.strain_signal.ratio < WEAK_SIGNAL:
        quantile = min(quantile, WEAK_QUANTILE)
    weights, flat = np.broadcast_to(system.areas, values.shape).ravel(), values.ravel()
    order = np.argsort(flat)
    share = np.cumsum(weights[order]) / weights.sum()
    return float(flat[order[min(int(np.searchsorted(share, quantile)), len(order) - 1)]])
