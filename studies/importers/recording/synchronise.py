"""Camera frames and the machine's force record on one clock; which frames become increments.

In: times of the frames and a `ForceRecord`. Out: frame numbers, and the force at each by linear interpolation.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from studies.output.words import Words

WORDS = Words("experiment")
Array = NDArray[np.float64]
Index = NDArray[np.int64]
BREAK_LEVEL, BREAK_DURATION = 0.5, 0.05


@dataclass(frozen=True)
class ForceRecord:
    """Load-cell record: time (n,) s, increasing; force (n,) N, positive in tension; source: for messages; crosshead (n,): its position, in any
    unit, where it was recorded. per_frame: one reading was taken with each frame.

    Readings without a force (NaN) are left out; blank: their numbers, from 1; unread: the frames whose own they would be. Raises `MissingForceError` for too few readings or none with a force,
    `TimeError`.
    """

    time: Array
    force: Array
    source: str = "force record"
    crosshead: Array | None = None
    per_frame: bool = False
    blank: tuple[int, ...] = field(default=(), init=False)

    def __post_init__(self) -> None:
        if len(self.time) < 2 or self.time.shape != self.force.shape:
            raise errors.MissingForceError(f"{self.source}: needs at least two readings of time and force")
        known = np.isfinite(self.force)
        if not known.any():
            raise errors.MissingForceError(f"{self.source}: contains no force")
        object.__setattr__(self, "blank", tuple((np.flatnonzero(~known) + 1).tolist()))
        object.__setattr__(self, "force", self.force[known])
        object.__setattr__(self, "time", self.time[known])
        if self.crosshead is not None:
            object.__setattr__(self, "crosshead", self.crosshead[known])
        backwards = ~(np.diff(self.time) > 0)
        if backwards.any() or not np.isfinite(self.time).all():
            row = int(np.flatnonzero(backwards)[0]) + 1 if backwards.any() else 0
            raise errors.TimeError(
                f"{self.source}: time does not increase at reading {row + 1} ({self.time[row]:g} s after "
                f"{self.time[row - 1]:g} s); sort the record or remove repeated readings"
            )

    @property
    def unread(self) -> Index:
        """Frames (k,) whose own reading has no force: a neighbour's is none of theirs."""
        return np.array(self.blank, np.int64) - 1 if self.per_frame else np.zeros(0, np.int64)

    def moved(self, before: Array, after: Array) -> ForceRecord:
        """With the frames, whose times (n_frames,), s, have changed, where it was read with these; else as it is."""
        if not self.per_frame:
            return self
        found = replace(self, time=np.interp(self.time, before, after))
        object.__setattr__(found, "blank", self.blank)
        return found


@dataclass(frozen=True)
class Selection:
    """Which frames become increments: all from the onset of loading to `until` (s; None: the last frame with a force), `count` spread evenly over
    that time, all where there are no more, or an explicit list. onset: fraction of the largest force.
    tare: force in N taken as zero; None: the force at frame 0, since displacements count from there."""

    count: int | None = None
    frames: tuple[int, ...] | None = None
    until: float | None = None
    onset: float = 0.01
    tare: float | None = None

    def __post_init__(self) -> None:
        if self.count is not None and self.count < 1:
            raise errors.ConfigError(f"number of frames {self.count}: at least 1 is needed")
        if not 0 <= self.onset < 1:
            raise errors.ConfigError(f"onset {self.onset} is a fraction of the largest force, from 0 to below 1")


DEFAULT_SELECTION = Selection()


def find_break(record: ForceRecord) -> tuple[float, float] | None:
    """Times (s) of the last reading before the force collapses and of the first after; None where it does not.

    A collapse is a fall below half of the largest force so far within 5 % of the record's duration, from which
    the force does not come back. Slow unloading, relaxation and cycles are none.
    """
    t, F = record.time, record.force - record.force[0]
    top = np.maximum.accumulate(F)
    fallen = (BREAK_LEVEL * top > F) & (top > 0.2 * F.max())
    if not fallen[-1]:
        return None
    first = int(np.flatnonzero(~fallen)[-1]) + 1
    start = int(np.flatnonzero(F[:first] >= 0.95 * top[first])[-1])
    if t[first] - t[start] > BREAK_DURATION * (t[-1] - t[0]):
        return None
    return float(t[start]), float(t[first])


def choose_frames(
    time: Array,
    record: ForceRecord,
    selection: Selection,
    broke: float | None = None,
    failed: Index = np.zeros(0, np.int64),
) -> tuple[Index, list[str]]:
    """Frame numbers that become increments, and notes on what was left out. time (n_frames,): of the frames, s;
    broke: of a failure, s; failed (k,): frames that are not chosen unless the selection lists them.

    Raises `ConfigError` for frames outside the record, `MissingForceError` when no frame has a force.
    """
    notes: list[str] = []
    end = min(float(time[-1]), float(record.time[-1]))
    if broke is not None and broke < end:
        end = broke
        notes.append(WORDS.note_failure(time=broke))
    if selection.frames is not None:
        return _explicit(time, record, selection.frames), notes
    if selection.until is not None:
        if selection.until > end + 1e-9:
            notes.append(WORDS.note_until(until=selection.until, end=end))
        end = min(end, selection.until)
    beyond = np.flatnonzero((time < record.time[0]) | (time > record.time[-1] + 1e-9))
    if beyond.size:
        notes.append(WORDS.note_beyond_record(frames=beyond.tolist(), start=record.time[0], end=record.time[-1]))
    force = forces_at(record, np.clip(time, record.time[0], record.time[-1]))
    usable = np.flatnonzero((time >= record.time[0]) & (time <= end + 1e-9) & (np.arange(len(time)) > 0))
    skipped = np.intersect1d(usable, failed)
    if 0 < skipped.size < usable.size:
        notes.append(WORDS.note_failed_frames(frames=skipped.tolist()))
        usable = np.setdiff1d(usable, skipped)
    usable = np.setdiff1d(usable, record.unread)
    if usable.size == 0:
        raise errors.MissingForceError(
            f"no frame has a force: frames run from {time[0]:g} to {time[-1]:g} s, the force record from "
            f"{record.time[0]:g} to {record.time[-1]:g} s; {_remedy(selection.until, float(time[1]) if len(time) > 1 else np.inf)}"
        )
    level = selection.onset * np.abs(force[usable] - force[0]).max()
    loaded = usable[np.abs(force[usable] - force[0]) > level]
    if loaded.size == 0:
        raise errors.MissingForceError("the force does not change over the frames; check the synchronisation")
    later = usable[usable >= loaded[0]]
    if selection.count is None or later.size <= selection.count:
        return later, notes
    targets = np.linspace(time[loaded[0]], time[usable[-1]], selection.count + 1)[1:]
    return np.unique([usable[np.argmin(np.abs(time[usable] - t))] for t in targets]), notes


def _remedy(until: float | None, first: float) -> str:
    """What to do where no frame is left; first: time of the first frame after the reference, s."""
    if until is not None and until < first:
        return f"--until {until:g} ends before the first of them after the reference, at {first:g} s"
    return "check frame rate and offset"


def _explicit(time: Array, record: ForceRecord, frames: tuple[int, ...]) -> Index:
    chosen = np.array(frames, dtype=np.int64)
    if chosen.size == 0 or (np.diff(chosen) <= 0).any() or chosen[0] < 1 or chosen[-1] >= len(time):
        raise errors.ConfigError(
            f"frames {list(frames)}: give increasing numbers from 1 to {len(time) - 1} (0 is rest)"
        )
    outside = (time[chosen] < record.time[0]) | (time[chosen] > record.time[-1]) | np.isin(chosen, record.unread)
    if outside.any():
        raise errors.MissingForceError(
            f"frame {chosen[outside][0]} at {time[chosen[outside][0]]:.2f} s has no force; the record runs from "
            f"{record.time[0]:g} to {record.time[-1]:g} s"
        )
    return chosen


def forces_at(record: ForceRecord, time: Array) -> Array:
    """Force (k,) N at times (k,) s within the record, by linear interpolation."""
    return np.interp(time, record.time, record.force)
