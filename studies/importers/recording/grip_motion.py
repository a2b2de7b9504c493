"""How the grips of a recorded test move: along the pull, across it, and whether the specimen broke.

In: a `Series`. Out: lengths in mm, a time in s, notes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from studies.importers.recording.recorded_series import Grip, Series
from studies.importers.recording.synchronise import find_break, forces_at
from studies.output.words import Words

WORDS = Words("experiment")
Array = NDArray[np.float64]
Index = NDArray[np.int64]
ACROSS = 2.0  # motion of the grips across the pull over that along it, from which they are hardly pulled that way
FEWEST, UNLIKE, LIKE = (
    5,
    0.7,
    0.95,
)  # frames, and correlations with the force, that tell displacements from increments of them
UNSEEN = 0.02  # of the range of lengths, by which a specimen may have been longer than its chosen frames show


def elongation(series: Series) -> Array:
    """Change of the distance between the grips along the pull (n_frames,), mm."""
    return grip_motion(series)[:, 0]


def grip_motion(series: Series) -> Array:
    """Motion of the grips against each other (n_frames, 2), mm: along the pull, and across it."""
    total = np.zeros((len(series.time), 2))
    for grip in series.grips:
        total += _mean(series.displacements[:, grip.nodes]) @ _along_and_across(grip)
    if len(series.grips) == 1:  # the other end may move along
        axes = _along_and_across(series.grips[0])
        along = series.points @ axes[:, 0]
        other = along <= along.min() + 0.1 * np.ptp(along)
        total -= _mean(series.displacements[:, other]) @ axes
    return total


def _mean(displacements: Array) -> Array:
    """Mean (n_frames, 2) over the points (n_frames, k, 2) that did not fail; NaN where all did."""
    known = np.isfinite(displacements)
    count = known.sum(axis=1)
    return np.where(count > 0, np.where(known, displacements, 0.0).sum(axis=1) / np.maximum(count, 1), np.nan)


def _along_and_across(grip: Grip) -> Array:
    """Columns (2, 2): direction of the pull, and the direction a quarter of a turn further."""
    x, y = grip.direction
    return np.array([[x, -y], [y, x]])


def moves_across(series: Series, frames: Index) -> tuple[float, float] | None:
    """How far grips that pull along one axis move along and across it, mm, where the latter is `ACROSS` times the former; else None."""
    if len({grip.direction[0] == 0 for grip in series.grips}) > 1:
        return None
    along, across = np.abs(grip_motion(series)[frames]).max(axis=0)
    return (float(along), float(across)) if across > ACROSS * along else None


def failure(series: Series) -> float | None:
    """Time (s) of the last reading before a break: the force collapses, the distance of the grips does not."""
    found = find_break(series.record)
    if found is None:
        return None
    length = np.interp(found, series.time, elongation(series))
    return None if length[1] < 0.9 * length[0] else found[0]


def looks_incremental(series: Series) -> bool:
    """Whether displacements seem to count from the frame before: their sum follows the force, they themselves do not."""
    length, force = elongation(series), forces_at(series.record, series.time)
    known = np.isfinite(length) & np.isfinite(force)
    length, force = length[known], force[known]
    rising = slice(0, int(np.argmax(np.abs(force))) + 1 if len(force) else 0)
    length, force = length[rising], force[rising]
    if len(force) < FEWEST or not np.ptp(force) > 0 or not np.ptp(length) > 0:
        return False
    total, summed = (abs(np.corrcoef(one, force)[0, 1]) for one in (length, np.cumsum(length)))
    return bool(total < UNLIKE and summed > LIKE)


def unseen_peak(lengths: Array, frames: Index) -> list[str]:
    """A note where the specimen was longer between chosen frames than in any chosen before. lengths (n_frames,): mm;
    frames (t,): those chosen."""
    known = np.where(np.isfinite(lengths), lengths, -np.inf)
    missed = np.maximum.accumulate(known)[frames] - np.maximum.accumulate(known[frames])
    worst = int(np.argmax(missed))
    if not missed[worst] > UNSEEN * np.ptp(lengths[np.isfinite(lengths)]):
        return []
    peak = int(np.argmax(known[: frames[worst] + 1]))
    return [WORDS.note_unseen_peak(peak=peak, longer=missed[worst], frame=frames[worst])]
