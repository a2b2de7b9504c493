"""Reader of the printed elastomer sheets: DIC frames on a regular pixel grid and a machine record.

In: a folder with one semicolon-separated CSV a frame (columns `x [pixel]`, `y [pixel]`, `x-displacement [pixel]`,
`y-displacement [pixel]`; grid fixed in the first frame) and a machine record (`Time`, `Displacement`, `Force`,
a row of units, quoted numbers), or both packed into one ``.npz``. Out: a `Series` in mm, y up, origin at the
centre of the grid.

The image's y points down: it is flipped for positions and displacements. The two outermost rows and columns are
unreliable. Rows are left out: the outermost rows kept are the loaded boundaries 'top' and 'bottom', since the
section force is the same at every height. Columns left out at the free edges would leave a strip that carries
about a tenth of the force without being measured; `edge_columns` says what is done about it.
"""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from studies.importers.recording.importer import SCALE_MM_PER_PIXEL, Importer, Recording, SheetOptions, arrays_in
from studies.importers.recording.missing_frames import with_missing_frames
from studies.importers.recording.series import Grip, Series
from studies.importers.recording.synchronise import ForceRecord
from studies.importers.text_tables import Layout, read_table

Array = NDArray[np.float64]
FRAME_RATE_HZ = 5.0
FRAME_COLUMNS = ("x [pixel]", "y [pixel]", "x-displacement [pixel]", "y-displacement [pixel]")
CROSSHEAD = "Displacement"
RECORD_COLUMNS = ("Time", CROSSHEAD, "Force")
RECORD_FILE = "force_disp.csv"
NUMBER = re.compile(r"(\d+)\.csv$")
PACKED = ("x_px", "y_px", "ux_px", "uy_px")


@dataclass(frozen=True)
class Frames:
    """Raw frames in pixels, image coordinates. points (n, 2); displacements (n_frames, n, 2), NaN = failed;
    frame_rate: Hz, None = unknown; numbers (n_frames,): in the names of the files, None = one after the other."""

    points: Array
    displacements: Array
    frame_rate: float | None = None
    numbers: Array | None = None

    @property
    def intervals(self) -> Array:
        """Frame intervals (n_frames,) since the first frame; a number that is left out is a picture that is not there."""
        numbers = np.arange(len(self.displacements)) if self.numbers is None else self.numbers
        return np.asarray(numbers - numbers[0], float)


def read_frames(folder: str | Path) -> Frames:
    """Read every frame ``*.csv`` of a folder, in the order of their numbers; the first is the reference.

    Points missing from a later frame count as failed. Raises `DataNotFoundError` for less than two frames,
    `FileFormatError` with file and line, `DegenerateMeshError` for points listed twice, `MeshMismatchError` for a point
    that is not in the first frame.
    """
    folder = Path(folder)
    paths = frame_files(folder)
    if len(paths) < 2:
        raise errors.DataNotFoundError(f"{folder}: {len(paths)} frames found; expected *.csv with a number each")
    tables = [read_frame(path) for path in paths]
    points = tables[0][:, :2]
    if len(np.unique(points, axis=0)) < len(points):
        raise errors.DegenerateMeshError(f"{paths[0]}: points are listed twice; export each point once")
    place = {tuple(p): i for i, p in enumerate(points)}
    displacements = np.full((len(paths), len(points), 2), np.nan)
    for k, (path, table) in enumerate(zip(paths, tables, strict=True)):
        try:
            index = [place[tuple(p)] for p in table[:, :2]]
        except KeyError as error:
            raise errors.MeshMismatchError(
                f"{path}: point {error} is not in the first frame {paths[0].name}; export every frame on the grid "
                "of the reference"
            ) from None
        displacements[k, index] = table[:, 2:]
    return Frames(points, displacements, numbers=np.array([frame_number(path) for path in paths], float))


def read_frame(path: str | Path) -> Array:
    """One frame (n, 4): x, y, displacement in x and y, pixels, image coordinates; NaN where a point failed.

    Raises `DataNotFoundError`, `FileFormatError`.
    """
    table = read_table(path, FRAME_COLUMNS, Layout(delimiter=";", missing_allowed=True))
    frame = np.stack([table[name] for name in FRAME_COLUMNS], axis=1)
    if not np.isfinite(frame[:, :2]).all():
        raise errors.FileFormatError(f"{path}: a point has no position; remove that row")
    return frame


def frame_files(folder: Path) -> list[Path]:
    """Frame files of a folder in the order of the number their names end with."""
    return sorted((p for p in folder.glob("*.csv") if NUMBER.search(p.name)), key=lambda p: (frame_number(p), p))


def frame_number(path: Path) -> int:
    """That the name of a frame file ends with."""
    found = NUMBER.search(path.name)
    assert found is not None
    return int(found.group(1))


def _is_frame(path: Path) -> bool:
    """Whether the header has a column of a frame; which are missing is said when it is read."""
    with open(path, encoding="latin-1") as file:
        header = file.readline()
    return any(name in header for name in FRAME_COLUMNS)


def read_record(path: str | Path) -> ForceRecord:
    """Machine record, s and N: quoted CSV, one row of units. Raises `DataNotFoundError`, `FileFormatError`,
    `TimeError`, `MissingForceError`."""
    table = read_table(path, ("Time", "Force"), Layout(units_row=True), optional=[CROSSHEAD])
    return ForceRecord(table["Time"], table["Force"], str(path), table.get(CROSSHEAD))


def read_packed(path: str | Path) -> tuple[Frames, ForceRecord | None]:
    """Frames and machine record of one packed ``.npz``. Raises `DataNotFoundError`, `FileFormatError`,
    `MeshMismatchError`, and the errors of a `ForceRecord`."""
    if not Path(path).is_file():
        raise errors.DataNotFoundError(f"{path}: no such file; give the path of a packed sheet")
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as data:
            content = {key: data[key].astype(np.float64) for key in data.files if data[key].dtype.kind in "fiu"}
        points = np.stack([content["x_px"], content["y_px"]], axis=1)
        displacements = np.stack([content["ux_px"], content["uy_px"]], axis=-1)
    except KeyError as error:
        raise errors.FileFormatError(f"{path}: array {error} is missing; is this a packed DIC sheet?") from None
    except Exception as error:  # of zip, of NumPy, of the system
        reason = "" if "pickle" in str(error) else f" ({error})"
        raise errors.FileFormatError(f"{path}: not a readable .npz{reason}; pack it again") from error
    if displacements.shape[1] != len(points):
        raise errors.MeshMismatchError(
            f"{path}: {displacements.shape[1]} displacements for {len(points)} points; pack the same grid for both"
        )
    record = None
    if "force_N" in content and "time_s" in content:
        record = ForceRecord(content["time_s"], content["force_N"], str(path), content.get("disp_mm"))
    rate = float(content["frame_rate_hz"]) if "frame_rate_hz" in content else None
    return Frames(points, displacements, rate), record


def sheet_series(
    frames: Frames, record: ForceRecord, options: SheetOptions = SheetOptions(), name: str = "sheet"
) -> Series:
    """Build the Series of a sheet pulled along y; see `SheetOptions`.

    Raises `MeshMismatchError` where the points are no full grid, `ConfigError` where too little of it is left.
    """
    order, columns, rows = _grid(frames.points)
    pixels = frames.points[order].reshape(rows, columns, 2)
    scale = options.scale or SCALE_MM_PER_PIXEL
    u = frames.displacements[:, order].reshape(-1, rows, columns, 2) * scale
    u[..., 1] *= -1.0
    low, high = pixels[0, 0], pixels[-1, -1]
    points = (pixels - 0.5 * (low + high)) * scale * np.array([1.0, -1.0])
    down, across = options.drop_rows, options.drop_columns
    if rows - 2 * down < 5 or columns - 2 * across < 12:
        raise errors.ConfigError(f"dropping {down} rows and {across} columns leaves too little of {columns} x {rows}")
    if options.edge_columns == "extrapolate":
        u = _extrapolated(u, across)
        across = 0
    elif options.edge_columns == "keep":
        across = 0
    # rows from the bottom up, so that numbering and triangles follow x to the right, y up
    keep = (slice(down, rows - down), slice(across, columns - across))
    points, u = points[keep][::-1], u[(slice(None), *keep)][:, ::-1]
    rows, columns = points.shape[:2]
    number = np.arange(rows * columns).reshape(rows, columns)
    sides = np.concatenate([number[1:-1, 0], number[1:-1, -1]])
    rate = options.frame_rate or frames.frame_rate or FRAME_RATE_HZ
    strip = across * float(np.median(np.diff(np.unique(frames.points[:, 0])))) * scale
    return Series(
        name=name,
        points=points.reshape(-1, 2),
        triangles=grid_triangles(rows, columns),
        displacements=u.reshape(len(u), -1, 2),
        time=frames.intervals / rate + options.offset,
        record=record,
        grips=(Grip("bottom", number[0], (0.0, -1.0)), Grip("top", number[-1], (0.0, 1.0))),
        free_nodes=sides if options.free_edges != "no" else np.zeros(0, np.int64),
        thickness=options.thickness,
        # frame 0 is known to one frame interval, evenly distributed
        synchronisation_std=1.0 / rate / np.sqrt(12.0),
        provenance={
            "reader": "DIC sheet on a pixel grid",
            "recording": {"image_scale": f"{scale:g} mm/pixel", "frame_rate": f"{rate:g} Hz"},
            "options": {**asdict(options), "frame_rate": rate},
            "grid": [columns, rows],
            "unmeasured_strip_mm": strip,
            "side_edges": "traction-free" if options.free_edges != "no" else "rim of the measured region",
        },
    )


class PrintedSheets(Importer):
    """A packed ``.npz``, or a folder of frames with ``force_disp.csv`` or a machine record of its own."""

    source: ClassVar[str] = "a packed .npz, a folder of frames"
    looks_for: ClassVar[str] = (
        f"numbered .csv with a column '{FRAME_COLUMNS[0]}', or {RECORD_FILE}, in a folder; {PACKED[0]} in a .npz"
    )

    def reads(self, source: str) -> bool:
        """A .npz with arrays of a packed sheet; a folder with the record of the machine, or with frames of their columns."""
        path = Path(source)
        if not path.is_dir():
            return not arrays_in(path).isdisjoint(PACKED)
        return (path / RECORD_FILE).is_file() or any(_is_frame(file) for file in frame_files(path)[:1])

    def read(self, source: str, options: SheetOptions, name: str | None, record: Path | None) -> Recording:
        """Frames and machine record; frames that the camera left out are found. Raises `MissingForceError` without a record."""
        path = Path(source)
        frames, forces, inputs = (_read_folder if path.is_dir() else _read_npz)(path, record)
        series = sheet_series(frames, forces, options, name or path.stem)
        series.provenance["source"] = path.name
        return Recording(with_missing_frames(series), inputs)


def _read_npz(path: Path, record_file: Path | None) -> tuple[Frames, ForceRecord, tuple[Path, ...]]:
    frames, record = read_packed(path)
    if record_file is not None:
        return frames, read_record(record_file), (path, record_file)
    if record is None:
        raise errors.MissingForceError(f"{path} holds no force record; give one with --record")
    return frames, record, (path,)


def _read_folder(path: Path, record_file: Path | None) -> tuple[Frames, ForceRecord, tuple[Path, ...]]:
    if record_file is None:
        record_file = path / RECORD_FILE
        if not record_file.is_file():
            raise errors.MissingForceError(f"{path} holds no {RECORD_FILE}; give the machine record with --record")
    record = read_record(record_file)
    return read_frames(path), record, (*frame_files(path), record_file)


def grid_triangles(rows: int, columns: int) -> NDArray[np.int64]:
    """Counter-clockwise triangles (m, 3) of a grid numbered row by row, bottom row first; diagonals alternate."""
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    even = (np.add.outer(np.arange(rows - 1), np.arange(columns - 1)) % 2 == 0)[..., None]
    first = np.where(even, np.stack([a, b, c], axis=-1), np.stack([a, b, d], axis=-1))
    second = np.where(even, np.stack([a, c, d], axis=-1), np.stack([b, c, d], axis=-1))
    return np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])


def _grid(points: Array) -> tuple[NDArray[np.int64], int, int]:
    """Order that sorts points into a full grid row by row (y down), and its columns and rows."""
    columns, rows = len(np.unique(points[:, 0])), len(np.unique(points[:, 1]))
    if columns * rows != len(points):
        raise errors.MeshMismatchError(
            f"{len(points)} points are no full grid of {columns} x {rows}; use a column map (TOML) for scattered points"
        )
    return np.lexsort((points[:, 0], points[:, 1])), columns, rows


def _extrapolated(u: Array, count: int) -> Array:
    """u (n_frames, rows, columns, 2) with the outermost `count` columns from a quadratic through the next seven.

    Failed points (NaN) are left out of the quadratic; with fewer than four points left the result is NaN.
    """
    if count == 0:
        return u
    known = np.arange(count, count + 7)
    u = u.copy()
    for side in (u, u[:, :, ::-1]):
        values = side[:, :, known]
        good = np.isfinite(values).all(axis=3)
        side[:, :, :count] = np.einsum("ek,frkc->frec", _quadratic(known, count), values)
        for frame, row in np.argwhere(~good.all(axis=2)):
            left = good[frame, row]
            fit = _quadratic(known[left], count) @ values[frame, row, left] if left.sum() >= 4 else np.nan
            side[frame, row, :count] = fit
    return u


def _quadratic(known: NDArray[np.int64], count: int) -> Array:
    """Weights (count, k): values at columns 0 to count - 1 of the quadratic through values at columns `known` (k,)."""
    return np.vander(np.arange(count), 3, increasing=True) @ np.linalg.pinv(np.vander(known, 3, increasing=True))
