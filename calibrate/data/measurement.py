"""What belongs to the points of an Experiment: forces of the grips, and the noise of displacements and forces."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrate import errors

Array = NDArray[np.float64]
ONE_CELL = 1e-7  # sum of two forces over their size, below which one load cell read both


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the measurement noise.

    displacement_std: per component, of what no other increment shares but by its correlation_time, mm.
    correlation_length: l in covariance std^2 exp(-r^2 / (2 l^2)), mm; 0 = uncorrelated between points.
    force_std_relative: standard deviation of a force relative to its magnitude.
    force_std: standard deviation of a force that does not scale with it, N. Both errors are independent: their variances add up.
    pattern_std: of an error that stays with the speckle pattern and grows with the deformation, at the largest one, mm.
    reference_std: of an error of the reference picture, which all increments share, mm.
    second_length, second_share: L, mm, of a second part of the noise, and its share f of the variance; 0 = one length alone.
    correlation_time: tau, in which displacement_std drifts from picture to picture, s, or increments where the Experiment has no time; 0 = new in
    every increment.

    With s the share of the deformation (`deformation_shares`) the covariance of the displacements of increments i and j at times t is
    (displacement_std^2 exp(-|t_i - t_j| / tau) + pattern_std^2 s_i s_j + reference_std^2) C(r), with C(r) = exp(-r^2 / (2 l^2)), or of two lengths
    (1 - f) exp(-r^2 / (2 l^2)) + f exp(-r^2 / (2 L^2)).
    Raises `ExperimentError` for what is negative or not finite, a share above 1, and where all noise is common to the increments.
    """

    displacement_std: float
    correlation_length: float = 0.0
    force_std_relative: float = 0.0
    force_std: float = 0.0
    pattern_std: float = 0.0
    reference_std: float = 0.0
    correlation_time: float = 0.0
    second_length: float = 0.0
    second_share: float = 0.0

    def __post_init__(self) -> None:
        for key, value in self.__dict__.items():
            if not np.isfinite(value) or value < 0:
                raise errors.ExperimentError(f"noise: {key} = {value} must be a finite number >= 0")
        if self.second_share > 1:
            raise errors.ExperimentError(
                f"noise: second_share = {self.second_share} is a share of the variance; give 0 to 1"
            )
        if self.is_common and not self.displacement_std > 0:
            raise errors.ExperimentError(
                "noise: pattern_std and reference_std are common to all increments; give displacement_std too, what is new in each"
            )

    def force_deviation(self, forces: Array) -> Array:
        """Standard deviations, N, of forces of any shape, N; unknown (NaN) where they are."""
        return np.hypot(self.force_std_relative * np.abs(forces), self.force_std)

    @property
    def is_common(self) -> bool:
        """Whether part of the noise of the displacements is common to all increments."""
        return self.pattern_std > 0 or self.reference_std > 0

    @property
    def is_correlated(self) -> bool:
        """Whether part of it is common to all increments, or drifts from each to the next."""
        return self.is_common or self.correlation_time > 0

    @property
    def total_std(self) -> float:
        """Of the displacements at the largest deformation, all parts together, mm."""
        return float(np.sqrt(self.displacement_std**2 + self.pattern_std**2 + self.reference_std**2))

    @property
    def lengths(self) -> tuple[tuple[float, float], ...]:
        """Correlation lengths, mm, each with its share of the variance."""
        both = (self.correlation_length, 1 - self.second_share), (self.second_length, self.second_share)
        return tuple(one for one in both if one[1] > 0)

    @property
    def mean_length(self) -> float:
        """Root mean square of the correlation lengths over the variance, mm: of one length that has as much noise in virtual fields far coarser."""
        return float(np.sqrt(sum(share * length**2 for length, share in self.lengths)))

    def scaled(self, factor: float) -> Noise:
        """With every part of the noise of the displacements times a factor."""
        names = ("displacement_std", "pattern_std", "reference_std")
        return replace(self, **{name: factor * getattr(self, name) for name in names})

    def counted_in(self, clock: Array | NDArray[np.int64]) -> Noise:
        """With the correlation time in steps of a clock (t,), their mean; as it is where there is one increment."""
        steps = len(clock) - 1
        step = float(np.ptp(clock)) / steps if steps else 1.0
        return replace(self, correlation_time=self.correlation_time / step)

    def own_between(self, time: Array) -> Array:
        """Correlation (t, t) of what increments at times (t,), s or increments, have of displacement_std; the identity without a drift."""
        apart = np.abs(np.subtract.outer(time, time))
        return np.exp(-apart / self.correlation_time) if self.correlation_time > 0 else np.eye(len(time))

    def common_between(self, shares: Array) -> Array:
        """Standard deviations (t, 2) of pattern and reference in increments with these shares of the deformation (t,), over displacement_std; (t, 0)
        where neither is there."""
        if not self.is_common:
            return np.zeros((len(shares), 0))
        return np.stack([self.pattern_std * shares, self.reference_std + 0 * shares], axis=1) / self.displacement_std

    def variances(self, shares: Array) -> Array:
        """Of all parts (t,) in increments with these shares of the deformation (t,), over displacement_std^2."""
        return np.asarray(1 + (self.common_between(shares) ** 2).sum(axis=1))


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


def one_cell(forces: Array) -> NDArray[np.bool_]:
    """Which pairs (f, f) of forces (t, f), N, along one axis were read by one load cell: those that are opposite in every increment in which both are
    known, to more digits than a cell has."""
    sums = forces[:, :, None] + forces[:, None]
    both, known = np.isfinite(sums), np.nan_to_num(forces)
    largest_sum = np.abs(np.nan_to_num(sums)).max(axis=0, initial=0.0)
    size = np.where(both, np.abs(known)[:, :, None], 0.0).max(axis=0, initial=0.0)
    return np.asarray(largest_sum < ONE_CELL * size)


def first_of_cell(forces: Array) -> Array:
    """Forces (t, f), N, along one axis, NaN where an earlier one of the increment was read by the same cell."""
    again = np.tril(one_cell(forces), -1) & np.isfinite(forces)[:, None, :]
    return np.where(again.any(axis=2), np.nan, forces)
