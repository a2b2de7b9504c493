"""muDIC: tables of nodes in pixels, written by a script of the user."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from studies.importers.exports.guesses import Guesses
from studies.importers.exports.text_files import TextFile
from studies.importers.vendors.vendor import Vendor, say_columns, say_layout, say_pixels


class MuDic(Vendor):
    """x, y, ux, uy."""

    name: ClassVar[str] = "muDIC"
    documentation: ClassVar[str] = "names of muDIC's fields; the file is written by the user"

    def claims(self, file: TextFile) -> bool:
        """x, y with ux, uy."""
        return set(file.names) >= {"x", "y", "ux", "uy"}

    def describe(self, frames: Sequence[TextFile], found: Guesses) -> None:
        """Pixels of the reference picture."""
        file = frames[0]
        say_layout(file, found)
        say_columns(file, found, {"x": "x", "y": "y", "u": "ux", "v": "uy"}, "fields of muDIC")
        say_pixels(found, "muDIC works in pixels")
        found.say("recording.software", "muDIC", "column names; version not stated")
