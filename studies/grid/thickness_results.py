"""What the thickness study has left in its folder, in the form that its tables, figures and words need.

In: a folder as `studies.grid.thickness_case` writes it. Out: `Results` with cases, fields and states; nothing is computed
here but selections, weighted quantiles and what one 3D solution says in a few numbers (`SolidNumbers`).
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forward.interpolation import Places, gradients_at, locate
from forward.solid.solid_solution import SolidSolution
from forward.solution import SurfaceSolution
from meshes import Cross
from studies.accuracy.epsilon import EpsilonField, difference
from studies.accuracy.stress_error import Reference, States
from studies.errors import DamagedFileError
from studies.grid.thickness_case import CORRECTED, LOSSES, PLANE, Settings, case_path, format_thickness
from studies.output import style

Array = NDArray[np.float64]
LINE_LENGTH = 25.0  # mm from a rim, at most half the way to the next hole
LINE_POINTS = 400
SHADES = ("blue", "green", "orange", "vermilion", "purple", "sky")
STROKES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)))


def _read[T](path: Path, reader: Callable[[Path], T]) -> T:
    """What `reader` makes of a file. Raises `DamagedFileError` if it is not what was written."""
    try:
        return reader(path)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, zlib.error, NotImplementedError) as error:
        raise DamagedFileError(f"{path}: damaged; delete it and run the same command again") from error


@dataclass(frozen=True)
class Line:
    """epsilon (k,) at the last increment at distances (k,), mm, from a rim. where: in words."""

    where: str
    distance: Array
    epsilon: Array


@dataclass(frozen=True)
class SolidNumbers:
    """Of one 3D solution: lines from rims outward; forces side to (n_inc,), N, along the pull, of the whole arm."""

    lines: list[Line]
    forces: dict[str, Array]


@dataclass(frozen=True)
class Results:
    """A finished study. settings: those of `studies.grid.thickness_case`."""

    folder: Path
    settings: Settings

    @property
    def thicknesses(self) -> list[str]:
        """Thicknesses as in file names, thinnest first."""
        return [format_thickness(h) for h in sorted(self.settings.thicknesses)]

    @property
    def conditions(self) -> list[str]:
        """The 2D reference and every thickness."""
        return [PLANE, *self.thicknesses]

    @cached_property
    def cases(self) -> list[dict[str, Any]]:
        """Every case, in the order of conditions and seeds."""
        return [_read(case_path(self.folder, condition, seed), lambda path: json.loads(path.read_text()))
                for condition in self.conditions for seed in self.settings.noise_seeds]  # fmt: skip

    def fits(self, condition: str, loss: str, noisy: bool) -> list[dict[str, Any]]:
        """Results of a loss, with its seed: of clean data (one), or of all noise seeds.

        A correction for the thickness leaves the 2D reference as it is.
        """
        if condition == PLANE and loss == CORRECTED and any(CORRECTED in c["losses"] for c in self.cases):
            loss = LOSSES[0]
        chosen = [c for c in self.cases if c["condition"] == condition and (c["seed"] != "clean") == noisy]
        return [{**c["losses"][loss], "seed": c["seed"]} for c in chosen if loss in c["losses"]]

    @cached_property
    def plane(self) -> SurfaceSolution:
        """The 2D plane-stress solution of the quarter, 1 mm thick."""
        return _read(self.folder / "plane.npz", SurfaceSolution.load)

    @cached_property
    def fields(self) -> dict[str, EpsilonField]:
        """epsilon by thickness."""
        return {name: _read(self.folder / f"epsilon_{name}.npz", EpsilonField.load) for name in self.thicknesses}

    @cached_property
    def states(self) -> States:
        """Deformation states of the 2D reference, all increments."""
        return _read(self.folder / "states.npz", States.load)

    @property
    def limit(self) -> float:
        """Upper end of the calibrated range of I1, the same for all conditions."""
        return float(self.cases[0]["calibrated_I1"])

    @cached_property
    def reference(self) -> Reference:
        """The truth at the states within the calibrated range."""
        return Reference.at(self.states.within(self.limit))

    def solid(self, name: str) -> SolidSolution:
        """The 3D solution of a thickness; large, so it is read anew each time."""
        return _read(self.folder / f"solid_{name}.npz", SolidSolution.load)

    @cached_property
    def numbers(self) -> dict[str, SolidNumbers]:
        """What every 3D solution says in a few numbers."""
        places = [(where, d, locate(self.plane.mesh, points)) for where, d, points in lines()]
        return {name: solid_numbers(self.solid(name), self.plane, places) for name in self.thicknesses}

    def inputs(self) -> list[Path]:
        """Files that the report is made of."""
        names = [*(f"solid_{h}.npz" for h in self.thicknesses), *(f"epsilon_{h}.npz" for h in self.thicknesses)]
        return [*(self.folder / name for name in ("plane.npz", "states.npz", *names)),
                *(case_path(self.folder, c, seed) for c in self.conditions for seed in self.settings.noise_seeds)]  # fmt: skip

    def look(self, condition: str) -> dict[str, Any]:
        """Colour and line of a condition, the same in every figure."""
        if condition == PLANE:
            return {"color": style.COLOURS["black"], "linestyle": "-", "linewidth": 1.0}
        i = self.thicknesses.index(condition) % len(SHADES)
        return {"color": style.COLOURS[SHADES[i]], "linestyle": STROKES[i]}

    def name(self, condition: str) -> str:
        """A condition in words."""
        return "2D reference" if condition == PLANE else f"{condition} mm"


def lines() -> Iterator[tuple[str, Array, Array]]:
    """(where, distances (k,), points (k, 2)) from the rims of two holes of the cross outward, along x and y, mm."""
    cross = Cross()
    a, b, at = cross.hole_semi_major, cross.hole_semi_minor, cross.outer_offset
    for where, start, axis, free in (
        ("central hole, along x", (a, 0.0), 0, (at - b - a) / 2),
        ("central hole, along y", (0.0, b), 1, (at - a - b) / 2),
        (f"hole at ({at:g}, 0), along x", (at + b, 0.0), 0, cross.half_length - at - b),
        (f"hole at ({at:g}, 0), along y", (at, a), 1, cross.half_width - a),
    ):
        distance = np.linspace(0, min(LINE_LENGTH, free), LINE_POINTS)
        yield where, distance, np.array(start) + distance[:, None] * np.eye(2)[axis]


def solid_numbers(
    solid: SolidSolution, plane: SurfaceSolution, places: list[tuple[str, Array, Places]]
) -> SolidNumbers:
    """Lines and forces of a 3D solution; `places`: lines located in the plane mesh."""
    n = len(plane.points)
    surface = solid.displacements[-1, -n:]
    found = []
    for where, distance, place in places:
        F_plane = np.eye(2) + gradients_at(plane.mesh, place, plane.displacements[-1])
        F_solid = np.eye(3)[:, :2] + gradients_at(plane.mesh, place, surface)
        found.append(Line(where, distance, difference(F_plane, F_solid)))
    return SolidNumbers(found, arm_forces(solid.reactions))


def arm_forces(reactions: dict[str, Array]) -> dict[str, Array]:
    """Force along the pull of each whole arm, N, from the reactions of a quarter (half an arm each)."""
    return {side: 2 * np.asarray(reactions[side])[:, axis] for side, axis in (("right", 0), ("top", 1))}
