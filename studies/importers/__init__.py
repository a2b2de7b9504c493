"""Importers: measured data of one vendor or layout in, a `Recording` out. One file each; a new one is found by itself.

Which one reads a source is told by its content: exactly one may say that it does.
"""

from __future__ import annotations

from pathlib import Path

from calibrate import errors
from studies.commandline.subclasses import concrete
from studies.importers.exports.text_files import text_file
from studies.importers.recording.importer import Importer, Processing, Recording, SheetOptions, arrays_in

SHOWN = 12  # columns that a message names
__all__ = ["Importer", "Processing", "Recording", "SheetOptions", "importer_of", "importers"]


def importers() -> list[Importer]:
    """An importer of every kind: those in modules of this folder, and those that were defined elsewhere."""
    kinds = concrete(Importer, __path__, __name__)
    return [kind() for kind in sorted(kinds, key=lambda kind: (kind.__module__, kind.__name__))]


def importer_of(source: str) -> Importer:
    """The one importer that reads a source. Raises `FileFormatError` where none does, or several do, `DataNotFoundError`."""
    known = importers()
    reading = [importer for importer in known if importer.reads(source)]
    if len(reading) > 1:
        raise errors.FileFormatError(f"{source}: {_names(reading)} both read this; let only one do so in its `reads`")
    if reading:
        return reading[0]
    if not Path(source).exists():
        kinds = " or ".join(importer.source for importer in known)
        raise errors.DataNotFoundError(f"{source}: no such file or folder; give {kinds}")
    if is_experiment(source):
        raise errors.FileFormatError(f"{source}: an Experiment already; give it to `equigap calibrate`")
    looked = "; ".join(importer.looks_for for importer in known if importer.looks_for)
    raise errors.FileFormatError(
        f"{source}: no importer reads this{_content(Path(source))}. Looked for: {looked}. Give other text tables by a column map (docs/import.md)"
    )


def _content(source: Path) -> str:
    """What there is instead, for a message: that a folder is empty, or the columns of its first table."""
    files = sorted(path for path in source.iterdir() if path.is_file()) if source.is_dir() else [source]
    if not files:
        return " (the folder holds no files)"
    tables = (text_file(path) for path in files)
    first = next((table for table in tables if table is not None and table.names), None)
    return "" if first is None else f" ({first.path.name} has the columns {', '.join(first.names[:SHOWN])})"


def is_experiment(source: str) -> bool:
    """Whether a file is an Experiment, which needs no importer."""
    return "loaded_names" in arrays_in(source)


def _names(found: list[Importer]) -> str:
    return " and ".join(f"{type(one).__name__} ({type(one).__module__})" for one in found)
