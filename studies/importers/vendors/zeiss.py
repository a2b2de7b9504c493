"""ZEISS Inspect (GOM Correlate) and ARAMIS: one CSV a stage; newer ones list the points where they are after displacement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from studies.importers.exports.guesses import Guesses
from studies.importers.exports.text_files import TextFile
from studies.importers.map_tables import TIME_UNITS
from studies.importers.text_tables import split
from studies.importers.vendors.vendor import Vendor, say_columns, say_layout, say_unit


class Zeiss(Vendor):
    """Surface components."""

    name: ClassVar[str] = "ZEISS/GOM Correlate"
    tested_on: ClassVar[str] = "github.com/gerlachjan/OperateOnDIC: 6 of 170 stages, stereo"
    documentation: ClassVar[str] = "its exports"

    def claims(self, file: TextFile) -> bool:
        """x, displacement_x and a row of the stage, or x_undef of ARAMIS."""
        newer = file.column("displacement_x") and any("relative_time" in line for line in file.before)
        return bool(newer or (file.column("x_undef") and file.column("u")))

    def describe(self, frames: Sequence[TextFile], found: Guesses) -> None:
        """Current coordinates with a stage row, reference coordinates of ARAMIS."""
        file = frames[0]
        say_layout(file, found)
        ends = ("x", "y", "z")
        where: tuple[str, ...]
        motion: tuple[str, ...]
        if file.column("displacement_x"):
            where, motion = ends, tuple(f"displacement_{c}" for c in ends)
            found.say("points.coordinates", "current", "x, y, z of this export are those after displacement")
        else:
            where, motion = tuple(f"{c}_undef" for c in ends), ("u", "v", "w")
        columns = {k: file.column(name) for k, name in zip("xyzuvw", (*where, *motion), strict=True)}
        both = columns["z"] and columns["w"]
        say_columns(file, found, {k: n for k, n in columns.items() if n and (both or k not in "zw")}, "named columns")
        unit = file.stated(r"length:\s*(\w+)") or file.unit(columns["x"] or "")
        say_unit(found, "points.unit", unit, "mm")
        found.say("points.y_axis", "up", "coordinate system of the specimen, not of the picture")
        found.say("recording.software", self.name, "layout of the file; version not stated")

    def stated_time(self, file: TextFile) -> float | None:
        """relative_time, s, of the stage row."""
        head = next((i for i, line in enumerate(file.before) if "relative_time" in line), None)
        if head is None or head + 1 >= len(file.before):
            return None
        names, values = (split(file.before[i], file.delimiter) for i in (head, head + 1))
        unit = TIME_UNITS.get(file.stated(r"time:\s*(\w+)") or "s")
        try:
            return None if unit is None else unit * float(values[names.index("relative_time")].replace(",", "."))
        except (ValueError, IndexError):
            return None
