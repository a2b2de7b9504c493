"""MatchID: tables with long column names, one file a picture; names as of 2018 to 2024."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from studies.importers.exports.guesses import Guesses
from studies.importers.exports.text_files import TextFile
from studies.importers.vendors.vendor import Vendor, say_columns, say_layout, say_unit

WHERE = {
    "x": ("coor.x", "coordinates.x", "coor.image x", "coordinates.image x"),
    "y": ("coor.y", "coordinates.y", "coor.image y", "coordinates.image y"),
    "z": ("coor.z", "coordinates.z"),
}
MOTION = {
    "u": ("disp.horizontal displacement u", "displacement.horizontal displacement u"),
    "v": ("disp.vertical displacement v", "displacement.vertical displacement v"),
    "w": ("disp.out-of-plane: w", "disp.out-of-plane displacement w"),
}
SHORT = {"x_pic", "y_pic", "x", "y", "u", "v"}


class MatchId(Vendor):
    """2D and stereo, table export."""

    name: ClassVar[str] = "MatchID (tables)"
    tested_on: ClassVar[str] = "github.com/cbbuaa/FEMU-DIC: one picture, 2D"
    documentation: ClassVar[str] = "column names in published scripts (2023: x_pic, 2024: coor., disp.)"

    def claims(self, file: TextFile) -> bool:
        """A horizontal displacement U, or x_pic."""
        return bool(file.column(*MOTION["u"])) or set(file.names) >= SHORT

    def describe(self, frames: Sequence[TextFile], found: Guesses) -> None:
        """Metric coordinates where there are any, else those of the picture."""
        file = frames[0]
        say_layout(file, found)
        short = not file.column(*MOTION["u"])
        columns = {k: file.column(*((k,) if short else names)) for k, names in (WHERE | MOTION).items()}
        both = columns["z"] and columns["w"]
        say_columns(file, found, {k: n for k, n in columns.items() if n and (both or k not in "zw")}, "named columns")
        say_unit(found, "points.position_unit", file.unit(columns["x"] or ""), "mm")
        say_unit(found, "points.displacement_unit", file.unit(columns["u"] or ""), "mm")
        pictured = "image" in (columns["x"] or "").casefold()
        found.say(
            "points.y_axis",
            "down",
            "coordinates of the picture" if pictured else "MatchID's y points down, as in the picture",
        )
        found.say("recording.software", "MatchID", "column names; version not stated")
