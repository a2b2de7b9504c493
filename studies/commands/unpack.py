"""`equigap unpack`: a packed test between two pads to tables of columns and a column map, to be changed and imported."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from studies.commandline.option_types import OutputFolder, Overwrite, default_folder
from studies.commandline.outcome import Outcome
from studies.importers.pad_tracks import write_tables
from studies.output import Manifest, open_output_folder


@dataclass(frozen=True)
class Unpacked(Outcome):
    """Tables that were written. columns: the column map."""

    columns: Path

    def lines(self) -> Iterable[str]:
        """Where the map is, and what reads it."""
        yield f"tables and column map: {self.columns}"
        yield f"next: equigap import {self.columns}"


def unpack(
    packed: Path, /, *, name: str | None = None, output: OutputFolder = None, overwrite: Overwrite = False
) -> Unpacked:
    """Write a packed test between two pads as tables of columns, with a column map to be changed (docs/ugly_data.md).

    The folder is results/unpack-NAME unless told.

    Args:
        packed: .npz with xt_dic_mm, xt_pad_mov_mm, ux_pad_mm and fx_pad_N
        name: of the experiment (default: that of the file)

    Raises:
        EquigapError: no such file, or another one.
    """
    settings = {"command": "unpack", "name": name, "packed": str(packed)}
    folder = open_output_folder(output or default_folder(f"unpack-{name or packed.stem}"), overwrite, settings)
    columns = write_tables(packed, folder, name)
    Manifest(settings=settings, inputs=[packed]).beside(columns)
    return Unpacked(columns)
