"""Files of an export that have the name of a frame and cannot be read as one: left out, they would shift the times and forces of all after them."""

from __future__ import annotations

import fnmatch
import re
from pathlib import Path

from calibrate import errors
from studies.importers.exports.text_files import TextFile


def refuse_empty(folder: Path, pattern: str | None, suffixes: set[str]) -> None:
    """Raises `FileFormatError`: a frame that is left out would shift the times and forces of all after it."""
    for path in sorted(folder.iterdir()):
        like_frame = path.suffix in suffixes and (pattern is None or fnmatch.fnmatch(path.name, pattern))
        if path.is_file() and like_frame and not path.stat().st_size:
            raise errors.FileFormatError(f"{path}: the file is empty; export it again, or take it out of the folder")


def refuse_headers_alone(folder: Path, tables: set[Path], names: set[str]) -> None:
    """Raises `FileFormatError` for a file that has the name of a frame and no row of numbers. tables: files that have some."""
    for path in sorted(folder.iterdir()):
        if path.is_file() and path not in tables and unnumbered(path) in names:
            raise errors.FileFormatError(
                f"{path}: no row of numbers, though it has the name of a frame; export it again, or take it out of the folder"
            )


def refuse_other_columns(unknown: list[TextFile], names: set[str]) -> None:
    """Raises `FileFormatError` for a table of no known program with the name of a frame, which would be missing among the pictures."""
    for file in unknown:
        name = unnumbered(file.path)
        if name in names and re.search(r"[^\W\d_]", Path(name).stem):
            raise errors.FileFormatError(
                f"{file.path}: other columns than those of the frames with such a name; export it again as these, take it out of the folder, or give it another name"
            )


def unnumbered(path: Path) -> str:
    """Name of a file with * for its numbers."""
    return re.sub(r"\d+", "*", path.name)
