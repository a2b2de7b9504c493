"""Skin between two pads, as packed from the in-vivo tests of the University of Franche-Comté (Sutula et al. 2020).

In: one ``.npz``: `xt_dic_mm` (frames, n, 2), positions of the points; `xt_pad_mov_mm` (frames, 2), position of the pad that moves;
`ux_pad_mm`, `fx_pad_N` (k,), displacement of that pad and force on it from the machine. Out: tables of columns, one a frame, a
table of forces with one row a frame, and a column map to begin with, which `equigap import` reads and an editor changes.

Machine and camera have no common clock: the force of a frame is that at the same displacement of the pad.
"""

from __future__ import annotations

import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from studies.importers.column_import import ColumnMapped
from studies.importers.recording.importer import Importer, Part, Recording, SheetOptions, arrays_in
from studies.output import write_csv
from studies.output.writing import write_text

Array = NDArray[np.float64]
KEYS = ("xt_dic_mm", "xt_pad_mov_mm", "ux_pad_mm", "fx_pad_N")
MAP = "columns.toml"
MAP_TEXT = """\
# Column map (docs/import.md) of a window of skin between two pads, made by `equigap unpack`; change it at will.
name = "NAME"

[points]
files = "frames/frame_*.csv"
x = "x"
y = "y"
u = "u"
v = "v"

[force]
file = "force.csv"
per_frame = true
force = "force"

[edges]
loaded = ["left", "right"]
"""


@dataclass(frozen=True)
class PadTest:
    """points (n, 2) and displacements (frames, n, 2), mm; pad, force (frames,): mm by which the pad moved outwards, N in tension."""

    points: Array
    displacements: Array
    pad: Array
    force: Array

    @classmethod
    def load(cls, path: Path) -> PadTest:
        """Raises `FileFormatError` for another file, `MissingForceError` where the pad moved further than the machine recorded."""
        content = _arrays(path)
        missing = [key for key in KEYS if key not in content]
        if missing:
            raise errors.FileFormatError(
                f"{path}: has no {', '.join(missing)}; a test between pads has {', '.join(KEYS)}"
            )
        positions = content["xt_dic_mm"]
        pad = np.linalg.norm(content["xt_pad_mov_mm"] - content["xt_pad_mov_mm"][0], axis=1)
        moved, force = np.abs(content["ux_pad_mm"]), np.abs(content["fx_pad_N"])
        if pad.max() > moved.max():
            raise errors.MissingForceError(
                f"{path}: the pad moves {pad.max():.3g} mm in the pictures and {moved.max():.3g} mm in the machine's record; "
                "leave out the frames beyond it"
            )
        rising = np.maximum.accumulate(moved)
        first = np.concatenate([[True], np.diff(rising) > 0])
        return cls(positions[0], positions - positions[0], pad, np.interp(pad, rising[first], force[first]))


def _arrays(path: Path) -> dict[str, Array]:
    try:
        with np.load(path) as content:
            return {key: np.asarray(content[key], float) for key in KEYS if key in content}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise errors.FileFormatError(f"{path}: no readable .npz ({error})") from error


def write_tables(path: Path, folder: Path, name: str | None = None) -> Path:
    """Write frames/frame_000.csv (x, y, u, v in mm), force.csv (pad in mm, force in N) and columns.toml; returns the last.

    name: of the experiment, None: that of the file. Raises what `PadTest.load` does.
    """
    test = PadTest.load(path)
    frames = folder / "frames"
    frames.mkdir(parents=True, exist_ok=True)
    for i, u in enumerate(test.displacements):
        rows: Any = np.concatenate([test.points, u], axis=1).tolist()
        write_csv(frames / f"frame_{i:03d}.csv", ("x", "y", "u", "v"), rows)
    write_csv(folder / "force.csv", ("pad", "force"), np.column_stack([test.pad, test.force]).tolist())
    write_text(folder / MAP, MAP_TEXT.replace("NAME", name or path.stem))
    return folder / MAP


class PadTracks(Importer):
    """The packed file itself, with the column map that `write_tables` begins with."""

    source: ClassVar[str] = "a packed .npz of points between two pads"
    looks_for: ClassVar[str] = f"{KEYS[0]} in a .npz"
    takes: ClassVar[tuple[Part, ...]] = ("name",)
    instead: ClassVar[str] = "make tables and a column map with `equigap unpack`, and say it there"

    def reads(self, source: str) -> bool:
        """A .npz that holds positions over time."""
        return KEYS[0] in arrays_in(source)

    def read(self, source: str, options: SheetOptions, name: str | None, record: Path | None) -> Recording:
        """Raises what `PadTest.load` and a column map do."""
        path = Path(source)
        with tempfile.TemporaryDirectory() as temporary:
            columns = write_tables(path, Path(temporary), name)
            found = ColumnMapped().read(str(columns), options, None, None)
        return Recording(found.series, (path,), found.processing)
