"""How the grips of a recorded test move: along the pull, across it, whether the specimen broke, and whether the crosshead moves when they do.

In: a `Series`. Out: lengths in mm, times in s, notes.
"""

from __future__ import annotations

from dataclasses import dataclass

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
AT_REST = 0.3  # speed of the crosshead at the beginning of its record over the mean, below which it starts there
ONSET, POWERS = (
    0.25,
    3,
)  # share of the elongation in which clocks are compared; of the crosshead's motion, for a load train that gives way
SEARCHED, STEP = 10.0, 0.01  # intervals of the pictures, either way, and between two times that are tried
EARLY = 8  # frames that are needed
BEYOND = 3.0  # standard deviations, within which two clocks are one
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


@dataclass(frozen=True)
class Clocks:
    """offset: how much later than stated the pictures were taken, on the clock of the machine, s; std: standard deviation, s; interval of the
    pictures, s; counted: standard deviation of the clock that the noise of the forces holds already, s."""

    offset: float
    std: float
    interval: float
    counted: float = 0.0

    @property
    def agree(self) -> bool:
        """Whether there is no lag to be found: none was measured, or none beyond the noise of the forces, and that to within one picture."""
        within = max(BEYOND * self.std, self.counted)
        return abs(self.offset) <= within and abs(self.offset) + 2 * self.std <= self.interval


def clocks(series: Series, counted: float = 0.0) -> Clocks | None:
    """The time of the pictures beside that of the machine, from when the grips start to move and when the crosshead does. counted: see `Clocks`.

    The elongation of the first frames, or of all where these are few, is a polynomial of the crosshead's motion, because the load train gives way. The standard deviation is that of
    the profile likelihood. None where the machine recorded no crosshead, or one that is already moving, and where the frames cannot tell to within
    one of them.
    """
    record = series.record
    if record.crosshead is None or not series.has_clock or not _starts_at_rest(record.time, record.crosshead):
        return None
    length = elongation(series)
    begun = np.flatnonzero(np.abs(length) > ONSET * np.nanmax(np.abs(length)))
    early = np.flatnonzero(np.isfinite(length[: begun[0]])) if begun.size else begun
    frames = early if len(early) >= EARLY else np.flatnonzero(np.isfinite(length))
    if len(frames) < EARLY:
        return None
    time, seen = series.time[frames], length[frames]
    crosshead = record.crosshead / np.ptp(record.crosshead)

    def misfit(shift: float) -> float:
        moved = np.interp(time + shift, record.time, crosshead)
        columns = np.stack([moved**k - moved[0] ** k for k in range(1, POWERS + 1)], axis=1)
        left = columns @ np.linalg.lstsq(columns, seen, rcond=None)[0] - seen
        return float(left @ left)

    interval = float(np.median(np.diff(series.time)))
    tried = interval * np.arange(-SEARCHED, SEARCHED, STEP)
    misfits = np.array([misfit(shift) for shift in tried])
    likely = tried[misfits <= misfits.min() * (1 + 1 / (len(frames) - POWERS - 1))]
    best = float(tried[np.argmin(misfits)])
    found = Clocks(best, max(float(np.abs(likely - best).max()), STEP * interval), interval, counted)
    return found if found.std < interval else None


def _starts_at_rest(time: Array, position: Array) -> bool:
    """Whether a crosshead starts to move when its record begins, or later."""
    moving = np.flatnonzero(np.abs(position - position[0]) > ONSET * np.ptp(position))
    mean = abs(position[moving[0]] - position[0]) / (time[moving[0]] - time[0]) if moving.size else 0.0
    return bool(mean > 0 and abs(position[1] - position[0]) < AT_REST * mean * (time[1] - time[0]))


def clock_notes(found: Clocks | None) -> list[str]:
    """Where the crosshead moves at another time than the grips."""
    return [] if found is None or found.agree else [WORDS.note_clocks(clocks=found)]


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
