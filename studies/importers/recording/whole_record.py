"""The machine record of a whole test, whichever frames become increments: forces of every grip at the rate of the machine.

In: a `Series`. Out: a `LoadRecord`, and notes. Its zero is that of the increments; it ends where the specimen failed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrate.data.load_record import LoadRecord
from studies.importers.recording.recorded_series import Series
from studies.importers.recording.synchronise import ForceRecord, forces_at
from studies.output.words import Words

WORDS = Words("experiment")
Array = NDArray[np.float64]
Index = NDArray[np.int64]
ROUNDING = 1e-9  # s
MOST = 20_000  # readings, above which every second, third, ... is kept


def whole_record(
    series: Series, tare: float, broke: float | None = None, origin: float = 0.0
) -> tuple[LoadRecord | None, list[str]]:
    """Every reading of the machine while all load cells read, up to a failure at `broke`, s; None where times only number the frames.

    origin: when the test begins, s, from where its times count. tare: of the machine, N; a load cell of its own counts from the first frame. Readings of several load cells are those at the times of the machine.
    """
    if not series.has_clock:
        return None, []
    notes = [WORDS.note_start(start=origin)] if abs(origin) > ROUNDING else []
    machine = series.record
    cells = [grip.record or machine for grip in series.grips]
    start, end = max(cell.time[0] for cell in cells), min(cell.time[-1] for cell in cells)
    end = end if broke is None else min(end, broke)
    inside = np.flatnonzero((machine.time >= start - ROUNDING) & (machine.time <= end + ROUNDING))
    if len(inside) < 2:
        return None, notes
    kept = thinned(machine.force[inside], MOST)
    if len(kept) < len(inside):
        notes.append(WORDS.note_record_thinned(kept=len(kept), readings=len(inside)))
    time = machine.time[inside[kept]]
    forces = [
        grip.force(forces_at(cell, time) - (tare if grip.record is None else at_rest(series, cell)))
        for grip, cell in zip(series.grips, cells, strict=True)
    ]
    crosshead = None if machine.crosshead is None else machine.crosshead[inside[kept]]
    if crosshead is not None and not np.isfinite(crosshead).all():
        notes.append(WORDS.note_crosshead_incomplete())
        crosshead = None
    return LoadRecord(time - origin, np.array(forces), crosshead), notes


def thinned(force: Array, most: int) -> Index:
    """Readings (k,) that are kept of force (n,), at most `most` and a few: every second, third, ..., the first and the last, and the largest and the
    smallest of all. What is left has the noise of single readings."""
    n = len(force)
    every = np.arange(0, n, -(-n // most))
    return np.unique(np.concatenate([every, [0, int(np.argmin(force)), int(np.argmax(force)), n - 1]]))


def at_rest(series: Series, record: ForceRecord) -> float:
    """Force of a record at frame 0, N."""
    rest = float(np.clip(series.time[0], record.time[0], record.time[-1]))
    return float(forces_at(record, np.array([rest]))[0])
