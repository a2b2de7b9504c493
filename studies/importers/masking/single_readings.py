"""Readings of a point that failed, or are wrong, in single frames: replaced by how its neighbours move between the frames before and after.

In: points and displacements of all frames. Out: `Bridged`.

Beside the straight line in time between the frames before and after, all points of a place move alike, whatever the load does: by the bend of their paths. A reading is wrong where
its bend is far from a plane through its neighbours', fitted robustly, over what is usual there (as `outliers` tests points; Westerweel and Scarano 2005), and where the frames before and after agree
with the neighbours: a step that stays, as of a slip or a crack, is no wrong reading. It is replaced by the straight line and a plane through the bends of the neighbours. Nothing is
extrapolated in time: what fails to the end stays failed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibrate.data.points import MAX_LOST
from calibrate.robust_deviation import TO_DEVIATION
from meshes.mesh import spacing_of
from studies.importers.masking.outliers import FLOOR, NEAREST, from_planes

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
LIMIT = 5.0  # usual distances, from which a reading is wrong: some nine standard deviations of normal noise
CURVED = 2.0  # times what a turn of the load bends beside a hole, that a reading may
STAYS = 0.5  # of its distance, by which the frames before and after may differ from the neighbours
LONGEST = 3  # frames in a row that are bridged
MOST = 0.25  # of the frames, in which a point may fail or be wrong; others are no matter of single frames
REPEATS = 4


@dataclass(frozen=True, eq=False)
class Bridged:
    """values (t, n, c): of all frames, with the readings replaced that are marked (t, n)."""

    values: Array
    replaced: Flags

    def to_dict(self) -> dict[str, int]:
        """For a provenance: how many readings, of how many points, and in the frame with most."""
        return {
            "readings": int(self.replaced.sum()),
            "points": int(self.replaced.any(axis=0).sum()),
            "most_in_a_frame": int(self.replaced.sum(axis=1).max(initial=0)),
        }


class _Between(NamedTuple):
    """Frames of support before and after each reading (t, n), and the share of the way to the latter; has (t, n): whether both are there."""

    before: NDArray[np.int64]
    after: NDArray[np.int64]
    share: Array
    has: Flags

    def straight(self, values: Array) -> Array:
        """(t, n, c) on the straight lines between the frames of support."""
        points = np.arange(values.shape[1])
        start, end = values[self.before, points], values[self.after, points]
        return np.asarray(start + self.share[..., None] * (end - start))


def bridged(points: Array, values: Array, looks: bool = True) -> Bridged:
    """points (n, 2), mm; values (t, n, c), mm: displacements, and what else is measured of a point, NaN where it failed. looks: whether wrong readings are sought among those that are
    there. Frames in which more failed than can be bridged stay as they are, and support none."""
    lost = ~np.isfinite(values).all(axis=2)
    whole = np.flatnonzero(lost.mean(axis=1) <= MAX_LOST)
    none = Bridged(values, np.zeros_like(lost))
    if len(whole) < 3 or len(points) <= 2 * NEAREST:
        return none
    near = cKDTree(points).query(points, k=NEAREST + 1)[1][:, 1:]
    some, failed = values[whole], lost[whole]
    bad = _wrong(points, some, failed, near) | failed if looks else failed.copy()
    bad &= bad.mean(axis=0) <= MOST
    if not bad.any():
        return none
    between = _between(bad | failed)
    bad &= between.has & (between.after - between.before <= LONGEST + 1)
    found = none.replaced.copy()
    found[whole] = bad
    filled = np.full(values.shape, np.nan)
    filled[found] = _filled(points, some, between, near, bad, failed)
    found &= np.isfinite(filled).all(axis=2)
    return Bridged(np.where(found[..., None], filled, values), found)


def _between(bad: Flags) -> _Between:
    """Of readings (t, n): the nearest good ones in time."""
    t, n = bad.shape
    frames = np.arange(t)[:, None]
    last = np.maximum.accumulate(np.where(bad, -1, frames), axis=0)
    following = np.minimum.accumulate(np.where(bad, t, frames)[::-1], axis=0)[::-1]
    own, outside = np.broadcast_to(frames, (t, n)), np.ones((1, n), np.int64)
    before = np.concatenate([-outside, last[:-1]])
    after = np.concatenate([following[1:], t * outside])
    has = (before >= 0) & (after < t)
    before, after = np.clip(before, 0, t - 1), np.clip(after, 0, t - 1)
    share = (own - before) / np.maximum(after - before, 1)
    return _Between(before, after, share, has)


def _wrong(points: Array, values: Array, failed: Flags, near: NDArray[np.int64]) -> Flags:
    """Readings (t, n) that jump from their neighbours and back, but for two in a row; the worst of a point's neighbouring frames first, then again beside it."""
    floor, numbers = FLOOR * spacing_of(points), np.arange(len(points))
    found = np.zeros(failed.shape, bool)
    for _ in range(REPEATS):
        between = _between(found | failed)
        # distances from the neighbours of the bend of each path, and of the way between the frames of support
        way = values[between.after, numbers] - values[between.before, numbers]
        good = between.has & ~found & ~failed
        bend, ahead = (from_planes(points, _known(some[..., :2], good, near), near).T
                       for some in (values - between.straight(values), way))  # fmt: skip
        bend = np.where(good, bend, 0.0)
        usual = np.array([np.maximum(np.median(frame[near], axis=1), np.median(frame)) for frame in bend])
        wrong = bend > LIMIT * TO_DEVIATION * np.maximum(usual, floor)
        turns = np.flatnonzero(wrong.any(axis=1))
        curved = from_planes(points, _known(values[turns, :, :2], good[turns], near), near).T
        wrong[turns] &= bend[turns] > CURVED * _turn(values, between)[turns, None] * curved
        wrong &= ~(ahead > STAYS * bend)
        first = np.pad(bend, ((1, 1), (0, 0)))
        wrong &= (bend >= first[:-2]) & (bend >= first[2:])
        if not wrong.any():
            break
        found |= wrong
    return found


def _turn(values: Array, between: _Between) -> Array:
    """How much the paths bend in each frame (t,), as a share of what the points have moved: where the load turns, the distance of a displacement from the plane of its neighbours, as beside a hole,
    bends by that share."""
    bend = values[..., :2] - between.straight(values[..., :2])
    size, moved = (np.sqrt(np.nanmedian((v**2).sum(axis=2), axis=1)) for v in (bend, values[..., :2]))
    return np.asarray(size / np.maximum(moved, 1e-300))


def _known(values: Array, good: Flags, near: NDArray[np.int64]) -> Array:
    """Values (t, n, 2), those that are not good replaced by the median of the good ones of the neighbours, of none by 0."""
    found = np.where(good[..., None], values, np.nan)
    for frame, bad in zip(found, ~good, strict=True):
        around = frame[near[bad]]
        some = np.isfinite(around).any(axis=(1, 2))
        middle = np.zeros((len(around), 2))
        middle[some] = np.nanmedian(around[some], axis=1)
        frame[bad] = middle
    return found


def _filled(
    points: Array, values: Array, between: _Between, near: NDArray[np.int64], bad: Flags, failed: Flags
) -> Array:
    """(k, c) of the bad readings (t, n); NaN where fewer than half of the neighbours are good in the three frames."""
    found = np.full((int(bad.sum()), values.shape[2]), np.nan)
    straight = between.straight(values)[bad]
    for i, (k, p) in enumerate(zip(*np.nonzero(bad), strict=True)):
        before, after, share = between.before[k, p], between.after[k, p], between.share[k, p]
        good = near[p][~(bad | failed)[[before, k, after]][:, near[p]].any(axis=0)]
        if len(good) < NEAREST // 2:
            continue
        start, now, end = values[before, good], values[k, good], values[after, good]
        bends = now - start - share * (end - start)
        plane = np.column_stack([np.ones(len(good)), points[good] - points[p]])
        found[i] = straight[i] + np.linalg.lstsq(plane, bends, rcond=None)[0][0]
    return found
