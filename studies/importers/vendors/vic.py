"""VIC-2D and VIC-3D of Correlated Solutions: CSV or text, one file a picture, sigma = -1 where nothing was matched."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from studies.importers.exports.guesses import Guesses
from studies.importers.exports.text_files import UNIT, TextFile
from studies.importers.text_tables import read_table
from studies.importers.vendors.vendor import Vendor, say_columns, say_layout, say_pixels, say_unit


def _plain(file: TextFile) -> set[str]:
    """Names without units; upper case matters."""
    return {UNIT.sub("", name) for name in file.names}


def _calibrated(file: TextFile, name: str) -> bool:
    """Whether a calibrated column has other values than 0."""
    return bool(np.nan_to_num(read_table(file.path, [name], file.layout)[name]).any())


class Vic(Vendor):
    """2D: pixels in lower case, calibrated with _c; 3D: metric in upper case."""

    name: ClassVar[str] = "VIC-2D, VIC-3D"
    documentation: ClassVar[str] = "VIC-2D and VIC-3D manuals, exported variables"

    def claims(self, file: TextFile) -> bool:
        """X, Y, Z, U, V, W, or x, y, u, v with sigma."""
        plain = _plain(file)
        return plain >= {"X", "Y", "U", "V"} or (plain >= {"x", "y", "u", "v", "sigma"} and "x_pic" not in plain)

    def describe(self, frames: Sequence[TextFile], found: Guesses) -> None:
        """Metric columns where there are any."""
        file = frames[0]
        say_layout(file, found)
        names = {UNIT.sub("", name): name for name in file.names}
        if "X" in names:
            keys = "xyuv" + ("zw" if {"Z", "W"} <= set(names) else "")
            say_columns(
                file, found, {k: names[k.upper()] for k in keys}, "metric columns of VIC-3D, reference positions"
            )
            say_unit(found, "points.unit", file.unit(names["X"]), "mm")
            found.say("points.y_axis", "up", "metric coordinate system")
        elif {"x_c", "y_c", "u_c", "v_c"} <= set(names) and _calibrated(file, names["x_c"]):
            say_columns(file, found, {k: names[f"{k}_c"] for k in "xyuv"}, "calibrated columns of VIC-2D")
            say_unit(found, "points.unit", file.unit(names["x_c"]), "mm")
            found.say("points.y_axis", "up", "calibrated coordinate system")
        else:
            say_columns(file, found, {k: names[k] for k in "xyuv"}, "columns of VIC-2D in pixels")
            say_pixels(found, "coordinates of the picture")
        if "sigma" in names:
            found.say("points.valid_column", names["sigma"], "-1 where a subset was not matched")
            found.say("points.valid_minimum", 0.0, "not negative where matched")
        if {"Z", "W", "sigma"} & set(names):  # X, Y, U, V alone may be of anything
            found.say("recording.software", "VIC-3D" if "X" in names else "VIC-2D", "column names; version not stated")
