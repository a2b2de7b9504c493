"""What belongs to the points of an Experiment: forces of the grips, and the noise of displacements and forces."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrate import errors

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the measurement noise.

    displacement_std: per component, new in every increment, mm.
    correlation_length: l in covariance std^2 exp(-r^2 / (2 l^2)), mm; 0 = uncorrelated between points.
    force_std_relative: standard deviation of a force relative to its magnitude.
    force_std: standard deviation of a force that does not scale with it, N.
    pattern_std: of an error that stays with the speckle pattern and grows with the deformation, at the largest one, mm.
    reference_std: of an error of the reference picture, which all increments share, mm.

    With s the share of the deformation (`deformation_shares`) the covariance of the displacements of increments i and j is
    (displacement_std^2 delta_ij + pattern_std^2 s_i s_j + reference_std^2) exp(-r^2 / (2 l^2)).
    Raises `ExperimentError` for what is negative or not finite, and where all noise is common to the increments.
    """

    displacement_std: float
    correlation_length: float = 0.0
    force_std_relative: float = 0.0
    force_std: float = 0.0
    pattern_std: float = 0.0
    reference_std: float = 0.0

    def __post_init__(self) -> None:
        for key, value in self.__dict__.items():
            if not np.isfinite(value) or value < 0:
                raise errors.ExperimentError(f"noise: {key} = {value} must be a finite number >= 0")
        if self.is_common and not self.displacement_std > 0:
            raise errors.ExperimentError(
                "noise: pattern_std and reference_std are common to all increments; give displacement_std too, what is new in each"
            )

    @property
    def is_common(self) -> bool:
        """Whether part of the noise of the displacements is common to all increments."""
        return self.pattern_std > 0 or self.reference_std > 0

    @property
    def total_std(self) -> float:
        """Of the displacements at the largest deformation, all parts together, mm."""
        return float(np.sqrt(self.displacement_std**2 + self.pattern_std**2 + self.reference_std**2))

    def scaled(self, factor: float) -> Noise:
        """With every part of the noise of the displacements times a factor."""
        names = ("displacement_std", "pattern_std", "reference_std")
        return replace(self, **{name: factor * getattr(self, name) for name in names})

    def between_increments(self, shares: Array) -> Array:
        """Covariance (t, t) of the displacements of a point in increments with these shares of the deformation (t,), over
        displacement_std^2; the identity without common parts."""
        if not self.is_common:
            return np.eye(len(shares))
        pattern, reference = self.pattern_std / self.displacement_std, self.reference_std / self.displacement_std
        return np.asarray(np.eye(len(shares)) + pattern**2 * np.outer(shares, shares) + reference**2)


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
