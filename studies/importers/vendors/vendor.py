"""What a vendor is: it recognises the files of a DIC program, and says what their columns mean.

In: text tables of a folder. Out: entries of [points], [frames] and [recording] of a column map, each with its reason.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

from studies.importers.exports.guesses import Guesses
from studies.importers.exports.text_files import TextFile
from studies.importers.map_tables import LENGTH_UNITS


class Vendor(ABC):
    """A program and layout. tested_on: the real export that its conformance test reads, nothing where none was at hand;
    documentation: where its column names are from."""

    name: ClassVar[str]
    tested_on: ClassVar[str] = ""
    documentation: ClassVar[str]

    @abstractmethod
    def claims(self, file: TextFile) -> bool:
        """Whether a table is a frame of it; of a matrix export, whether it is one of the displacement along x."""

    @abstractmethod
    def describe(self, frames: Sequence[TextFile], found: Guesses) -> None:
        """Say what the columns mean, and what the header states of the recording. frames: in their order."""

    def stated_time(self, file: TextFile) -> float | None:
        """Time of a frame as its file states it, s."""
        return None

    def channels(self, frames: Sequence[TextFile]) -> dict[str, str]:
        """Columns of the frames that may be the force of the machine, one value a file, with their ranges in words."""
        return {}

    def belongs(self, file: TextFile) -> bool:
        """Whether a table that is no frame is part of the export all the same, and no record of a machine."""
        return False


def say_layout(file: TextFile, found: Guesses) -> None:
    """How its tables are written."""
    names = {";": "semicolons", ",": "commas", "\t": "tabulators", " ": "blanks"}
    found.say("points.delimiter", file.delimiter, f"{names[file.delimiter]} between the columns")
    if file.decimal == ",":
        found.say("points.decimal", ",", "decimal commas")
    if file.comment:
        found.say("points.comment", file.comment, "lines above the header")
    if file.header_line != 1:
        why = "no header" if file.is_matrix else "first line with as many fields as the numbers below it"
        found.say("points.header_line", file.header_line, why)
    if file.units:
        found.say("points.units_row", True, "row of units below the header")


def say_columns(file: TextFile, found: Guesses, columns: dict[str, str], why: str) -> None:
    """Which columns are x, y, u, v (and z, w)."""
    for key, name in columns.items():
        found.say(f"points.{key}", name, why)


def say_pixels(found: Guesses, why: str) -> None:
    """Positions and displacements in pixels of the picture, y down."""
    found.say("points.unit", "px", why)
    found.say("points.y_axis", "down", "rows of a picture count downwards")


SPELLED = dict.fromkeys(("pixel", "pixels", "pix"), "px") | dict.fromkeys(("µm", "μm", "micron", "microns"), "um")
SPELLED |= dict.fromkeys(("inch", "inches"), "in") | dict.fromkeys(("millimeter", "millimetre", "millimeters"), "mm")
LENGTHS = ("px", *LENGTH_UNITS)


def say_unit(found: Guesses, key: str, unit: str | None, otherwise: str) -> None:
    """A unit of length as a column states it, in any spelling; where none is stated that of the program. An unknown one is asked for."""
    if unit:
        say_stated_unit(found, unit, "the header", key)
    else:
        found.say(key, otherwise, "unit not stated; that of the program")


def say_stated_unit(found: Guesses, unit: str | None, where: str, key: str = "points.unit") -> None:
    """A unit of length that is stated somewhere; otherwise it is asked for."""
    stated = SPELLED.get((unit or "").casefold(), (unit or "").casefold())
    if stated in LENGTHS:
        found.say(key, stated, f"unit in {where}")
    else:
        why = f"[{unit}] is no known unit of length" if unit else f"not stated in {where}"
        found.ask(key, "--unit", f"{why}: one of {', '.join(LENGTHS)}")
