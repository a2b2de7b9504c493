"""MatchID, matrix export: one quantity a file, no header, a value for every subset of the grid, blank or not a number where none."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import ClassVar

from studies.importers.exports.guesses import Guesses
from studies.importers.exports.text_files import TextFile
from studies.importers.vendors.vendor import Vendor, say_layout, say_stated_unit

QUANTITY = re.compile(r"_([A-Za-z][\w-]*) ?\[([^\]]+)\]$")
LEAST = 4  # columns of a matrix


class MatchIdMatrix(Vendor):
    """Files such as ``picture_U[mm].csv``."""

    name: ClassVar[str] = "MatchID (matrices)"
    tested_on: ClassVar[str] = "github.com/lelliollo/MatchId-DataReader-Matlab: U of two pictures"
    documentation: ClassVar[str] = "its exports"

    def claims(self, file: TextFile) -> bool:
        """A matrix whose name ends with _U[unit]."""
        quantity = QUANTITY.search(file.path.stem)
        return file.is_matrix and file.columns >= LEAST and quantity is not None and quantity.group(1).upper() == "U"

    def belongs(self, file: TextFile) -> bool:
        """A matrix of another quantity."""
        return file.is_matrix and QUANTITY.search(file.path.stem) is not None

    def describe(self, frames: Sequence[TextFile], found: Guesses) -> None:
        """u and v by what the names end with; positions from files of X and Y, or a distance that has to be given."""
        file = frames[0]
        say_layout(file, found)
        found.say("points.layout", "matrix", "numbers without header, one quantity a file")
        quantity = QUANTITY.search(file.path.stem)
        assert quantity is not None
        ending, unit = quantity.group(0), quantity.group(2)
        say_stated_unit(found, unit, "the file names", "points.displacement_unit")
        for key, letter in (("u", "U"), ("v", "V"), ("x", "X"), ("y", "Y")):
            name = ending.replace(f"_{quantity.group(1)}", f"_{letter}", 1)
            others = [f.path.with_name(f.path.name.replace(ending, name)) for f in frames]
            if all(other.is_file() for other in others):
                found.say(f"points.{key}", name, f"files of {letter} beside one another")
            elif key == "v":
                missing = [other.name for other in others if not other.is_file()]
                found.ask(
                    "points.v",
                    "export the vertical displacement too",
                    f"{len(missing)} files missing, such as {missing[0]}",
                )
        if not (found.get("points.x") and found.get("points.y")):
            found.entries.pop("points.x", None)
            found.entries.pop("points.y", None)
            found.ask("points.step", "--step", "matrices without coordinates: distance of their points, mm")
        found.say("points.position_unit", "mm", "positions as the displacements")
        found.say("points.y_axis", "down", "rows of a matrix count downwards")
        found.say("recording.software", "MatchID", "file names; version not stated")
