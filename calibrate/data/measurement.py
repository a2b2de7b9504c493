"""What belongs to the points of an Experiment: forces of the grips, and the noise of displacements and forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrate import errors

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the measurement noise.

    displacement_std: per component and increment, mm.
    correlation_length: l in covariance std^2 exp(-r^2 / (2 l^2)), mm; 0 = uncorrelated between points.
    force_std_relative: standard deviation of a force relative to its magnitude.
    force_std: standard deviation of a force that does not scale with it, N.

    Raises `ExperimentError` for what is negative or not finite.
    """

    displacement_std: float
    correlation_length: float = 0.0
    force_std_relative: float = 0.0
    force_std: float = 0.0

    def __post_init__(self) -> None:
        for key, value in self.__dict__.items():
            if not np.isfinite(value) or value < 0:
                raise errors.ExperimentError(f"noise: {key} = {value} must be a finite number >= 0")


@dataclass(frozen=True)
class LoadedBoundary:
    """A gripped edge: its nodes (k,) and the force of the grip ON the specimen (n_increments, 2), N.

    A component that was not measured is NaN. held: components of the displacement that the grip prescribes; along another
    one the edge slides, free of traction and of force. A corner may belong to two edges that hold different components.
    """

    name: str
    nodes: NDArray[np.int64]
    force: Array
    held: tuple[bool, bool] = (True, True)
