"""Noise of a load cell, estimated from its record by the variate difference method (Tintner 1940; von Neumann et al. 1941).

In: time (n,) s and force (n,) N of a record. Out: `ForceNoise`.

A divided difference of order k over k + 1 neighbouring readings vanishes for every polynomial below degree k. Divided by the norm of
its weights it has the standard deviation of one reading, if errors are independent. What is left of the curvature of the record falls
with the order, what is left of noise does not: the order is raised until the estimate no longer falls. Where it still falls at the
highest order that the readings allow, curvature cannot be told from noise, and the estimate is only an upper bound. Coarse digits hide noise from it: it is no less
than the rounding of the last digit, its step over sqrt(12).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from calibrate.robust_deviation import robust_std

Array = NDArray[np.float64]
ORDERS = (2, 3, 4)
WINDOWS = 3  # fewest differences that an estimate is made of
REPEATED, RETURNS = (
    0.5,
    0.02,
)  # of the readings, where a last digit shows: different values at most; changes of direction at least
FALLS = 1.5  # factor between the estimates of two orders, from which the lower one holds curvature


class Origin(StrEnum):
    """Where the noise of a force is from."""

    ESTIMATED = "estimated"
    UPPER_BOUND = "upper bound"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class ForceNoise:
    """std, N, of one reading. order: of the differences it was found from, 0: too few readings. upper_bound: curvature is part of it,
    or may be."""

    std: float
    order: int
    upper_bound: bool

    @property
    def origin(self) -> Origin:
        """What kind of number `std` is."""
        if self.order == 0:
            return Origin.UNKNOWN
        return Origin.UPPER_BOUND if self.upper_bound else Origin.ESTIMATED


def force_noise(time: Array, force: Array) -> ForceNoise:
    """Noise of a record time (n,) s, increasing, force (n,) N, that is smooth but for noise and a few jumps."""
    orders = [order for order in ORDERS if len(time) - order >= WINDOWS]
    if not orders:
        return ForceNoise(0.0, 0, False)
    least = _rounding(force)
    found = [max(least, _deviation(differences(time, force, order))) for order in orders]
    for order, lower, higher in zip(orders, found, found[1:], strict=False):
        if lower <= FALLS * higher:
            return ForceNoise(lower, order, False)
    return ForceNoise(found[-1], orders[-1], True)


def _rounding(force: Array) -> float:
    """Standard deviation, N, of the error of the last digit: of readings (n,) that are few values over and over, between which they go to and fro, the digit is the smallest step; 0 of others, as of a load
    that is held without noise."""
    values, moves = np.unique(force), np.diff(force)
    moves = moves[moves != 0.0]
    returns = np.sum(moves[1:] * moves[:-1] < 0)
    if len(values) < 2 or len(values) > REPEATED * len(force) or returns < RETURNS * len(force):
        return 0.0
    return float(np.diff(values).min() / np.sqrt(12.0))


def differences(time: Array, force: Array, order: int) -> Array:
    """Divided differences (n - order,) of force (n,) at time (n,), each with weights of unit norm."""
    windows = np.lib.stride_tricks.sliding_window_view(time, order + 1)
    windows = (windows - windows[:, :1]) / (windows[:, -1:] - windows[:, :1])
    gaps = windows[:, :, None] - windows[:, None, :]
    gaps[:, np.arange(order + 1), np.arange(order + 1)] = 1.0
    weights = 1.0 / gaps.prod(axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    readings = np.lib.stride_tricks.sliding_window_view(force, order + 1)
    return np.einsum("ij,ij->i", weights, readings)


def _deviation(values: Array) -> float:
    """Standard deviation from the median of absolute values, so that a few jumps do not count."""
    return float(robust_std(values))
