"""Frames that a camera left out, found in the pictures themselves, and the times that follow.

In: a `Series` whose frames were taken at an even rate. Out: the same with the time of every frame after a gap corrected.

A force that was read with each frame stays with it. A frame that was not stored shows as one step of the displacement that is two, three, ... times as long as its
neighbours and has the same field. Without the correction every later force belongs to another picture. A slip or a crack
has another field than the motion before and after, and is left alone; so is a step that is no whole multiple.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrate.robust_deviation import robust_std
from studies.importers.recording.series import Series
from studies.output.words import Words

WORDS = Words("experiment")
Array = NDArray[np.float64]
WINDOW = 15  # steps on either side that tell the length of a step
STEADY = 0.15  # of their length, by which those may differ
WHOLE = 0.25  # of a step, from the nearest whole number
ALIKE = 0.98  # cosine of the fields of a long step and of its neighbours


def with_missing_frames(series: Series) -> Series:
    """The series with gaps in its times; its provenance lists them under 'missing_frames'."""
    gaps = missing_frames(series.time, series.displacements)
    if not gaps:
        return series
    interval = float(np.median(np.diff(series.time)))
    time = series.time.copy()
    for frame, count in gaps.items():
        time[frame:] += count * interval
    notes = [WORDS.note_missing_frames(count=count, frame=frame) for frame, count in gaps.items()]
    provenance = {
        **series.provenance,
        "missing_frames": {str(frame): count for frame, count in gaps.items()},
        "notes": [*series.provenance.get("notes", []), *notes],
    }
    grips = tuple(
        grip if grip.record is None else replace(grip, record=grip.record.moved(series.time, time))
        for grip in series.grips
    )
    record = series.record.moved(series.time, time)
    return replace(series, time=time, record=record, grips=grips, provenance=provenance)


def missing_frames(time: Array, displacements: Array) -> dict[int, int]:
    """How many frames are missing before which: {frame: count}.

    time (n_frames,) s; displacements (n_frames, n, 2) mm, NaN where a point failed. Empty where times are uneven, or
    where the motion is not steady enough to tell.
    """
    interval = np.diff(time)
    if len(time) < 2 * WINDOW or np.ptp(interval) > 0.01 * np.median(interval):
        return {}
    points = np.isfinite(displacements).all(axis=(0, 2))
    if not points.any():
        return {}
    steps = np.diff(displacements[:, points], axis=0).reshape(len(time) - 1, -1)
    found = {}
    for k in range(len(steps)):
        near = np.array([j for j in range(max(k - WINDOW, 0), min(k + WINDOW + 1, len(steps))) if j != k])
        # the step as a multiple of the mean of its neighbours, which are compared with that mean in the same way
        mean = np.median(steps[near], axis=0)
        size = float(mean @ mean)
        if size == 0.0:
            continue
        lengths = steps[near] @ mean / size
        spread = robust_std(lengths - np.median(lengths))
        ratio = float(steps[k] @ mean / size)
        cosine = ratio * np.sqrt(size) / max(float(np.linalg.norm(steps[k])), 1e-300)
        count = round(ratio) - 1
        if spread < STEADY and count >= 1 and abs(ratio - 1 - count) < WHOLE and cosine > ALIKE:
            found[k + 1] = count
    return found
