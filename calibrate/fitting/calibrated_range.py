"""Which invariants the data of a calibration reach, and in which modes: equations or states of homogeneous tests in, ranges of I1 and I2 out.

Modes are told by the Lode angle of the Hencky strain (`calibrate.equations.inputs.hencky_to_lode`): a state is near the homogeneous test whose angle is nearest.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.equations.deformation_modes import MODES, TITLES
from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.inputs import hencky_to_lode
from calibrate.equations.kinematics import INVARIANTS, invariants_and_derivatives

Array = NDArray[np.float64]
QUANTILE = 0.999
ANGLES = {"uniaxial": -np.pi / 6, "pure_shear": 0.0, "equibiaxial": np.pi / 6}  # of Lode
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


def mode_ranges(system: Equilibrium, increments: NDArray[np.bool_] | None = None) -> dict[str, tuple[float, float]]:
    """Range of I1 near each mode of `MODES`, by the names of `near`: to where all but a thousandth of the whole area has the mode left behind; to 3 where no more than that is near it."""
    F = system.isochoric_gradients if increments is None else system.isochoric_gradients[increments]
    return {name: (3.0, _largest(system, I1, QUANTILE)) for name, I1 in _by_mode(F).items()}


def curve_ranges(F: Array) -> dict[str, tuple[float, float]]:
    """Range of I1 and I2, and of I1 near each mode, that states F (m, 2, 2) of homogeneous tests reach; to 3 near a mode without a state.

    A sheet under uniaxial compression is one under equi-biaxial tension, and the other way round.
    """
    values = np.asarray(invariants_and_derivatives(jnp.asarray(F))[0])
    whole = {name: (3.0, float(values[:, i].max())) for i, name in enumerate(INVARIANTS)}
    return whole | {name: (3.0, float(I1.max())) for name, I1 in _by_mode(F).items()}


def _by_mode(F: Array) -> dict[str, Array]:
    """I1 (...) of F (..., 2, 2) that are nearest to a mode, 3 of the others, by the names of `near`."""
    angles = hencky_to_lode(F.reshape(-1, 2, 2))[1].reshape(F.shape[:-2])
    nearest = np.abs(angles[..., None] - np.array([ANGLES[mode] for mode in MODES])).argmin(axis=-1)
    I1 = np.asarray(invariants_and_derivatives(jnp.asarray(F))[0])[..., 0]
    return {near(mode): np.where(nearest == i, I1, 3.0) for i, mode in enumerate(MODES)}


def near(mode: str) -> str:
    """Name of the range of I1 near a mode, in a model file."""
    return f"I1 near {TITLES[mode]}"


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
