"""Load cells of a column map: machine records in, forces on the clock of the frames out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from studies.importers.column_map import ColumnMap
from studies.importers.exports.hdf5_file import read_columns
from studies.importers.exports.picture_rows import rows_of_pictures
from studies.importers.frame_tables import frame_files
from studies.importers.map_tables import FORCE_UNITS, TIME_UNITS, ForceTable, FramesTable
from studies.importers.recording.synchronise import ForceRecord
from studies.importers.text_tables import read_words

Array = NDArray[np.float64]


def load_cells(m: ColumnMap, folder: Path, n_frames: int) -> tuple[list[ForceRecord], Array]:
    """A record of every [[force]], and the time (n_frames,) of every frame on their clock, s.

    Raises the errors of tables and records, `MeshMismatchError` for another number of forces or times than frames.
    """
    found = [_load_cell(cell, m, folder, n_frames) for cell in m.force]
    time = found[0][1]
    for cell, (record, own) in zip(m.force, found, strict=True):
        if not np.allclose(own, time, rtol=0.0, atol=1e-9 * max(1.0, float(np.ptp(time)))):
            raise errors.TimeError(
                f"{record.source}: '{cell.force}' puts the frames at other times than '{m.force[0].force}' "
                f"(the last at {own[-1]:g} and {time[-1]:g} s); give every [[force]] that is per_frame its time, or none of them"
            )
    return [record for record, _ in found], time


def _load_cell(cell: ForceTable, m: ColumnMap, folder: Path, n_frames: int) -> tuple[ForceRecord, Array]:
    path = folder / (m.points.folder if cell.in_frames else cell.file)
    names = [name for name in (cell.force, cell.time, cell.crosshead) if name]
    table = _in_frames(m, folder, names) if cell.in_frames else read_columns(path, names, cell.text)
    if cell.picture:
        rows = _rows(cell, path, m, folder)
        table = {name: values[rows] for name, values in table.items()}
    force = cell.sign * FORCE_UNITS[cell.unit] * table[cell.force]
    scale = TIME_UNITS[cell.time_unit]
    if not cell.per_frame:
        assert cell.time is not None
        crosshead = table[cell.crosshead] if cell.crosshead else None
        return ForceRecord(scale * table[cell.time], force, str(path), crosshead), _times(m.frames, n_frames)
    time = scale * table[cell.time] if cell.time else None
    if len(force) == n_frames - 1 and m.points.reference == "separate":  # no row for a picture without a file
        force = np.concatenate([[0.0], force])
        if time is not None and len(time) < 2:
            raise errors.TimeError(
                f"{path}: one reading does not tell when the reference picture was taken; add its row, with a force of 0"
            )
        time = None if time is None else np.concatenate([[2 * time[0] - time[1]], time])
    if len(force) != n_frames:
        raise errors.MeshMismatchError(f"{path}: {len(force)} forces for {n_frames} frames; one row a frame is needed")
    time = _times(m.frames, n_frames) if time is None else time
    return ForceRecord(time, force, str(path), per_frame=True), time


def _rows(cell: ForceTable, path: Path, m: ColumnMap, folder: Path) -> list[int]:
    """Rows of the pictures of all frames; of a reference picture without a file the first row, unless that is another's."""
    assert cell.picture is not None
    files = [file.name for file in frame_files(m.points, folder)[0]]
    found = rows_of_pictures(read_words(path, cell.picture, cell.text), files)
    rows = [row for row in found if row is not None]
    if len(rows) < len(files):
        raise errors.MeshMismatchError(
            f"{path}: '{cell.picture}' has no row, or several, for the picture of {files[found.index(None)]}; correct it, or leave force.picture out"
        )
    return [0, *rows] if m.points.reference == "separate" and min(rows) > 0 else rows


def _in_frames(m: ColumnMap, folder: Path, names: list[str]) -> dict[str, Array]:
    """One value of each from the file of every frame."""
    found = []
    for path in frame_files(m.points, folder)[0]:
        values = read_columns(path, names, m.points.text)
        several = next((name for name in names if len(values[name]) != 1), None)
        if several:
            raise errors.FileFormatError(
                f"{path}: {len(values[several])} values of '{several}'; force.in_frames needs one a file"
            )
        found.append(values)
    return {name: np.concatenate([values[name] for values in found]) for name in names}


def _times(frames: FramesTable, n_frames: int) -> Array:
    """Times of the frames, s, as stated or at an even rate."""
    if frames.times_s is None:
        return np.arange(n_frames) / (frames.rate_hz or 1.0) + frames.offset_s
    if len(frames.times_s) != n_frames:
        raise errors.MeshMismatchError(
            f"frames.times_s: {len(frames.times_s)} times for {n_frames} frames; a time for every frame is needed, the reference too"
        )
    return np.array(frames.times_s) + frames.offset_s
