"""Noise of a load cell, estimated from its record by the variate difference method (Tintner 1940; von Neumann et al. 1941).

In: time (n,) s and force (n,) N of a record; of one with a reading a picture also the elongation (n,) mm. Out: `ForceNoise`.

A divided difference of order k over k + 1 neighbouring readings vanishes for every polynomial below degree k. Divided by the norm of
its weights it has the standard deviation of one reading, if errors are independent. What is left of the curvature of the record falls
with the order, what is left of noise does not: the order is raised until the estimate no longer falls. Where it still falls at the
highest order that the readings allow, curvature cannot be told from noise: the estimate may hold some, and has the scatter of few differences; what the noise is at most is told beside it.
Coarse digits hide noise from it: it is no less than the rounding of the last digit, its step over sqrt(12).

Differences across a turning point are left out: where the elongation turns, or, where it is not known, the force does, unless it turns so often that this may be noise. A rate that changes bends the force over time,
not over the elongation: differences over the latter are taken where they are clearly smaller.
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
REPEATED = 0.5  # of the readings, where a last digit shows: different values at most
RETURNS = 0.02  # and changes of direction at least
FALLS = 1.5  # factor between the estimates of two orders, or courses, from which the larger one holds curvature
BETWEEN_TURNS = 2  # fewest differences where some are left out
TURN = 0.1  # way back, of the range, that makes a turning point
OFTEN = 3  # readings a turn, below which those of the force may be noise
SCATTER = 5.0  # of an estimate of m differences that still falls: the noise is at most 1 + SCATTER / sqrt(m) times as much, but for 1 in 20 simulated curves of 9 to 50 readings
TIED = 1e-6  # of the range: elongations that are no further apart count as one


class Origin(StrEnum):
    """Where the noise of a force is from."""

    ESTIMATED = "estimated"
    MAY_HOLD_CURVATURE = "estimated, may hold curvature"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class ForceNoise:
    """std, N, of one reading. order: of the differences it was found from, 0: too few readings. may_hold_curvature: it is no less than what curvature leaves. count: of the differences."""

    std: float
    order: int
    may_hold_curvature: bool
    count: int = 0

    @property
    def origin(self) -> Origin:
        """What kind of number `std` is."""
        if self.order == 0:
            return Origin.UNKNOWN
        return Origin.MAY_HOLD_CURVATURE if self.may_hold_curvature else Origin.ESTIMATED

    @property
    def most(self) -> float:
        """What the noise is at most, N, with the scatter of an estimate that may hold curvature; of others `std`."""
        return self.std * (1 + SCATTER / self.count**0.5) if self.may_hold_curvature else self.std


def force_noise(time: Array, force: Array, elongation: Array | None = None) -> ForceNoise:
    """Noise of a record time (n,) s, increasing, force (n,) N, that is smooth but for noise, turning points and a few jumps. elongation (n,), mm: at each reading, where it is known."""
    turns = _turns(force if elongation is None else elongation)
    if elongation is None and OFTEN * len(turns) > len(force):
        turns = turns[:0]
    found = _along(time, force, turns)
    if elongation is None:
        return found
    other = _along(elongation, force, turns)
    return other if other.order and (not found.order or FALLS * other.std < found.std) else found


def _along(course: Array, force: Array, turns: NDArray[np.int64]) -> ForceNoise:
    """Noise of force (n,) N, smooth over a course (n,) but for turning points, numbers of readings."""
    least, fewest = _rounding(force), BETWEEN_TURNS if len(turns) else WINDOWS
    values = {k: differences(course, force, k)[_usable(course, turns, k)] for k in ORDERS if len(force) - k >= WINDOWS}
    orders = [order for order, kept in values.items() if len(kept) >= fewest]
    if not orders:
        return ForceNoise(0.0, 0, False)
    found = [max(least, _deviation(values[order])) for order in orders]
    for order, lower, higher in zip(orders, found, found[1:], strict=False):
        if lower <= FALLS * higher:
            return ForceNoise(lower, order, False, len(values[order]))
    return ForceNoise(found[-1], orders[-1], True, len(values[orders[-1]]))


def _usable(course: Array, turns: NDArray[np.int64], order: int) -> NDArray[np.bool_]:
    """Which windows (n - order,) of order + 1 readings have no turning point within, and a course that goes on from each reading to the next."""
    steps = np.lib.stride_tricks.sliding_window_view(np.diff(course), order)
    first = np.arange(len(steps))[:, None]
    across = ((first < turns) & (turns < first + order)).any(axis=1)
    least = TIED * np.ptp(course)
    return np.asarray(~across & ((steps > least).all(axis=1) | (steps < -least).all(axis=1)))


def _turns(values: Array) -> NDArray[np.int64]:
    """Numbers of the readings (n,) from which they go back by more than `TURN` of their range."""
    least, best, way = TURN * np.ptp(values), 0, 0
    found: list[int] = []
    for k, value in enumerate(values):
        gone = value - values[best]
        if way * gone > 0 or (way == 0 and abs(gone) > least):
            best, way = k, int(np.sign(gone))
        elif way * gone < -least:
            found.append(best)
            best, way = k, -way
    return np.array(found, np.int64)


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
    """Divided differences (n - order,) of force (n,) at time (n,), each with weights of unit norm; NaN where two times are one."""
    windows = np.lib.stride_tricks.sliding_window_view(time, order + 1)
    with np.errstate(divide="ignore", invalid="ignore"):
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
