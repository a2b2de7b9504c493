"""ncorr of Georgia Tech: one .mat for a whole test, see `studies.importers.exports.ncorr_file`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from studies.importers.exports.guesses import Guesses
from studies.importers.exports.ncorr_file import COLUMNS
from studies.importers.exports.text_files import TextFile
from studies.importers.vendors.vendor import Vendor, say_unit


class Ncorr(Vendor):
    """Formatted displacements at the points of the reference."""

    name: ClassVar[str] = "ncorr"
    documentation: ClassVar[str] = "ncorr manual 1.2.2, section 2.10, and published scripts"

    def claims(self, file: TextFile) -> bool:
        """The variable of ncorr."""
        return file.names == COLUMNS

    def describe(self, frames: Sequence[TextFile], found: Guesses) -> None:
        """Units and spacing are in the file."""
        file = frames[0]
        found.say("points.layout", "ncorr", "data_dic_save in a .mat")
        for key, name in zip("uv", COLUMNS, strict=True):
            found.say(f"points.{key}", name, "at the points of the reference")
        unit = file.stated(r"^units: (.+)")
        say_unit(found, "points.unit", {"pixels": "px"}.get(unit or "", unit), "mm")
        found.say("points.y_axis", "down", "rows of a picture count downwards")
        found.facts.append("0 in both components counts as not matched; points are spacing + 1 pixels apart")
        found.say("recording.software", "ncorr", "variable of the file")
        for key, stated in (("subset", file.stated(r"^radius: (.+)")), ("step", file.stated(r"^spacing: (.+)"))):
            if stated:
                found.say(
                    f"recording.{key}",
                    f"radius {stated} px" if key == "subset" else f"{int(float(stated)) + 1} px",
                    "dispinfo",
                )
