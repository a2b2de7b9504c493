"""Istra4D of Dantec Dynamics: one HDF5 file a step, with coordinates, displacements and analog channels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from studies.importers.exports.guesses import Guesses
from studies.importers.exports.hdf5_file import read_columns, units
from studies.importers.exports.text_files import TextFile
from studies.importers.vendors.vendor import Vendor, say_columns, say_stated_unit

WHERE, MOTION = "coordinates/coordinate_", "displacements/displacement_"
MASK, ANALOG = "coordinates/mask", "add_data/analog_channels"


class Istra4D(Vendor):
    """2D and 3D evaluations."""

    name: ClassVar[str] = "Istra4D"
    documentation: ClassVar[str] = "istra2py of the Karlsruhe Institute of Technology, which reads its HDF5 export"

    def claims(self, file: TextFile) -> bool:
        """Datasets of coordinates and displacements."""
        return set(file.names) >= {WHERE + "x", WHERE + "y", MOTION + "x", MOTION + "y"}

    def describe(self, frames: Sequence[TextFile], found: Guesses) -> None:
        """Datasets as columns; the unit of length is asked for unless an attribute states it."""
        file = frames[0]
        both = {WHERE + "z", MOTION + "z"} <= set(file.names)
        keys = "xyz" if both else "xy"
        columns = {k: WHERE + k for k in keys} | {k: MOTION + c for k, c in zip("uvw", keys, strict=False)}
        say_columns(file, found, columns, "datasets of Istra4D")
        say_stated_unit(found, units(file.path, WHERE + "x"), "its attributes")
        found.say("points.y_axis", "up", "coordinate system of the specimen, not of the picture")
        if MASK in file.names:
            found.say("points.valid_column", MASK, "1 where a facet was matched")
            found.say("points.valid_minimum", 0.5, "1 where a facet was matched")
        found.say("recording.software", self.name, "datasets of the file; version not stated")

    def channels(self, frames: Sequence[TextFile]) -> dict[str, str]:
        """Analog channels of a step, and their ranges over all."""
        if not all(ANALOG in frame.names for frame in frames):
            return {}
        values = [read_columns(frame.path, [ANALOG], frame.layout)[ANALOG] for frame in frames]
        count = min(len(row) for row in values)
        table = np.array([row[:count] for row in values])
        return {
            f"{ANALOG}[{k}]": f"{low:.4g} to {high:.4g}"
            for k, (low, high) in enumerate(zip(table.min(0), table.max(0), strict=True))
        }
