"""DICe of Sandia: text, one file a frame, lines of *** above the header, columns as the user chose them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from studies.importers.exports.guesses import Guesses
from studies.importers.exports.text_files import TextFile
from studies.importers.vendors.vendor import Vendor, say_columns, say_layout, say_pixels


class Dice(Vendor):
    """2D and stereo."""

    name: ClassVar[str] = "DICe"
    tested_on: ClassVar[str] = "github.com/dicengine/dice: DIC Challenge sample 12 (2D), left camera of a stereo set"
    documentation: ClassVar[str] = "DICe user's manual, output fields"

    def claims(self, file: TextFile) -> bool:
        """COORDINATE_X with DISPLACEMENT_X, or those of the model; not a table of one subset over all frames."""
        names = set(file.names)
        if "FRAME" in names:
            return False
        return names >= {"COORDINATE_X", "DISPLACEMENT_X"} or names >= {"MODEL_COORDINATES_X", "MODEL_DISPLACEMENT_X"}

    def describe(self, frames: Sequence[TextFile], found: Guesses) -> None:
        """Stereo where the model's coordinates are there, else the picture of one camera."""
        file = frames[0]
        say_layout(file, found)
        if "MODEL_COORDINATES_X" in file.names:
            columns = {k: f"MODEL_COORDINATES_{k.upper()}" for k in "xyz"}
            columns |= {k: f"MODEL_DISPLACEMENT_{c}" for k, c in zip("uvw", "XYZ", strict=True)}
            say_columns(file, found, columns, "coordinates of the stereo model")
            found.say("points.unit", "mm", "unit of the stereo calibration; mm unless calibrated otherwise")
            found.say("points.y_axis", "down", "the model has the axes of the first camera")
        else:
            columns = {k: f"COORDINATE_{k.upper()}" for k in "xy"} | {"u": "DISPLACEMENT_X", "v": "DISPLACEMENT_Y"}
            say_columns(file, found, columns, "columns of DICe")
            say_pixels(found, "coordinates of the picture")
        if "CROSS_CORR_Q" in file.names and "MODEL_COORDINATES_X" not in file.names:
            found.facts.append("left camera of a stereo set without the coordinates of the model: read as one camera")
        self._validity(file, found)
        self._recording(file, found)

    @staticmethod
    def _validity(file: TextFile, found: Guesses) -> None:
        """SIGMA or MATCH: -1 where matching failed."""
        column = next((name for name in ("SIGMA", "MATCH") if name in file.names), None)
        if column:
            found.say("points.valid_column", column, "-1 where a subset was not matched")
            found.say("points.valid_minimum", 0.0, "not negative where matched")
        else:
            found.facts.append("neither SIGMA nor MATCH: failed subsets cannot be told from their columns")

    @staticmethod
    def _recording(file: TextFile, found: Guesses) -> None:
        """What the lines of *** say."""
        if file.stated(r"\((git sha1: [^)]*)\)"):
            found.say("recording.software", f"DICe ({file.stated(r'git sha1: ([^)]*)')})", "header")
        for key, pattern, unit in (
            ("subset", r"Subset size: (\d+)", " px"),
            ("step", r"Step size: x (\d+)", " px"),
            ("strain_window", r"Strain window size in pixels: (\d+)", " px"),
            ("interpolation", r"Interpolation method: (\w+)", ""),
            ("shape_functions", r"Shape functions: (.+)", ""),
            ("matching_criterion", r"Correlation method: (\w+)", ""),
        ):
            stated = file.stated(pattern)
            if stated:
                found.say(f"recording.{key}", stated + unit, "header")
