"""The record of the testing machine: forces of the load cells over the whole test, at their own rate, and where the crosshead was.

In: times, forces and positions. Out: `LoadRecord`, and where between two pictures the motion is at any time.

Force between pictures is data: a relaxation time shorter than the time from one picture to the next shows there alone. What moves is seen in the
pictures only; in between the displacements go straight from one to the next, as fast as the crosshead does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrate import errors

Array = NDArray[np.float64]
ROUNDING = 1e-9  # s
BACKWARDS = 0.05  # of the way between two pictures, that noise of the crosshead may go back
STANDS = 1e-3  # of the range of the crosshead between two pictures, below which it stands


@dataclass(frozen=True)
class LoadRecord:
    """time (r,), s, on the clock of the Experiment; force (b, r, 2), N, of the grip ON the specimen at each of the loaded boundaries, in their order,
    NaN for what was not measured; crosshead (r,): its position, in any unit, None where it was not recorded.

    Raises `TimeError` for a time that is not finite or does not increase, `MeshMismatchError` for other shapes, `MissingForceError` for less than two
    readings, or a force that is known in some only, `ExperimentError` for a crosshead that is not finite.
    """

    time: Array
    force: Array
    crosshead: Array | None = None

    def __post_init__(self) -> None:
        for name in ("time", "force", "crosshead"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.float64))
        self._check_shapes()
        backwards = ~(np.diff(self.time) > 0)
        if backwards.any() or not np.isfinite(self.time).all():
            where = int(np.flatnonzero(backwards)[0]) + 2 if backwards.any() else 1
            raise errors.TimeError(
                f"machine record: time does not increase at reading {where}; sort it, or drop repeated readings"
            )
        known = np.isfinite(self.force)
        some = known.any(axis=1) & ~known.all(axis=1)
        if some.any():
            boundary, component = np.argwhere(some)[0]
            reading = int(np.flatnonzero(~known[boundary, :, component])[0]) + 1
            raise errors.MissingForceError(
                f"machine record: no force along {'xy'[component]} at loaded boundary {boundary + 1} in reading {reading}, though in others; leave that reading out"
            )
        if self.crosshead is not None and not np.isfinite(self.crosshead).all():
            raise errors.ExperimentError("machine record: the position of the crosshead is not finite; leave it out")

    def _check_shapes(self) -> None:
        r = self.time.shape
        if len(r) != 1 or self.force.ndim != 3 or self.force.shape[1:] != (*r, 2):
            raise errors.MeshMismatchError(
                f"machine record: force {self.force.shape} does not match time {r}; expected (loaded boundaries, readings, 2)"
            )
        if self.crosshead is not None and self.crosshead.shape != r:
            raise errors.MeshMismatchError(f"machine record: crosshead {self.crosshead.shape} does not match time {r}")
        if r[0] < 2:
            raise errors.MissingForceError("machine record: needs at least two readings")

    def check(self, time: Array | None, n_boundaries: int) -> None:
        """Whether it belongs to pictures at time (t,), s, and so many loaded boundaries. Raises `TimeError`, `MeshMismatchError`."""
        if len(self.force) != n_boundaries:
            raise errors.MeshMismatchError(
                f"machine record: forces of {len(self.force)} boundaries, {n_boundaries} are loaded; give one for each"
            )
        if time is None:
            raise errors.TimeError("machine record: the pictures have no time; give it, or leave the record out")
        if time[0] < self.time[0] - ROUNDING or time[-1] > self.time[-1] + ROUNDING:
            raise errors.TimeError(
                f"machine record: runs from {self.time[0]:g} to {self.time[-1]:g} s, the pictures from {time[0]:g} to {time[-1]:g} s; "
                "check the clocks (offset), or leave out the pictures beyond it"
            )

    def at(self, times: Array) -> Array:
        """Forces (b, k, 2), N, at times (k,), s, straight lines between readings."""
        flat = np.moveaxis(self.force, 1, 0).reshape(len(self.time), -1)
        found = np.stack([np.interp(times, self.time, column) for column in flat.T], axis=1)
        return np.moveaxis(found.reshape(len(times), len(self.force), 2), 1, 0)

    def progress(self, pictures: Array, times: Array) -> Array:
        """Where the motion is at times (k,), s, counted in pictures at `pictures` (t,), s: 0 at rest at 0 s, 1 at the first picture, 1.5 half of the
        way from there to the second.

        As far as the crosshead is on its way from the one to the next; where it was not recorded, stands, or turns in between, as time goes.
        """
        knots = pictures if pictures[0] == 0 else np.concatenate([[0.0], pictures])
        found = np.interp(times, knots, np.arange(len(knots), dtype=float))
        if self.crosshead is not None:
            position = np.interp(knots, self.time, self.crosshead)
            for i in range(len(knots) - 1):
                inside = (times > knots[i]) & (times < knots[i + 1])
                course = self._course(knots[i], knots[i + 1], position[i], position[i + 1])
                if inside.any() and course is not None:
                    found[inside] = i + np.interp(times[inside], *course)
        return found + float(pictures[0] == 0)

    def _course(self, start: float, end: float, first: float, last: float) -> tuple[Array, Array] | None:
        """Times and shares of the way between two pictures, from 0 to 1 and never back; None where the crosshead stands or turns."""
        assert self.crosshead is not None
        if not abs(last - first) > STANDS * np.ptp(self.crosshead):
            return None
        inside = (self.time > start) & (self.time < end)
        share = np.concatenate([[0.0], (self.crosshead[inside] - first) / (last - first), [1.0]])
        risen = np.maximum.accumulate(share)
        if (risen - share).max() > BACKWARDS or share.max() > 1 + BACKWARDS:
            return None
        return np.concatenate([[start], self.time[inside], [end]]), np.clip(risen, 0.0, 1.0)
