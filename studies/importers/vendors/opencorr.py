"""OpenCorr: CSV, one file a picture, pixels; zncc tells how well a subset was matched."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from studies.importers.exports.guesses import Guesses
from studies.importers.exports.text_files import TextFile
from studies.importers.vendors.vendor import Vendor, say_columns, say_layout, say_pixels


class OpenCorr(Vendor):
    """2D results."""

    name: ClassVar[str] = "OpenCorr"
    documentation: ClassVar[str] = "source of OpenCorr, oc_io.cpp"

    def claims(self, file: TextFile) -> bool:
        """x, y, u, v with zncc."""
        return set(file.names) >= {"x", "y", "u", "v"} and any(n.casefold() == "zncc" for n in file.names)

    def describe(self, frames: Sequence[TextFile], found: Guesses) -> None:
        """Pixels of the reference picture."""
        file = frames[0]
        say_layout(file, found)
        say_columns(file, found, {k: k for k in "xyuv"}, "columns of OpenCorr")
        say_pixels(found, "coordinates of the picture")
        found.say(
            "points.valid_column",
            next(n for n in file.names if n.casefold() == "zncc"),
            "negative where matching failed",
        )
        found.say("points.valid_minimum", 0.0, "not negative where matched")
        found.say("recording.software", "OpenCorr", "column names; version not stated")
