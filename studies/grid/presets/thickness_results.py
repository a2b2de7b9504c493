"""What the thickness study has left in its folder: cases, solutions, fields of epsilon and states.

In: a study's folder. Out: `ThicknessResults`; a condition is a thickness as in file names, or the 2D reference. Lengths in mm.
"""

from __future__ import annotations

from collections.abc import Iterator
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
from studies.grid.axes import PLANE, Case, Loss
from studies.grid.case import Fit
from studies.grid.results import Results, read
from studies.output import style

Array = NDArray[np.float64]
SPECIMEN = "cross"
LINE_LENGTH = 25.0  # mm from a rim, at most half the way to the next hole
LINE_POINTS = 400
NEAR_HOLE = 5.0  # mm, in which the largest epsilon of a line is looked for
SHADES = ("blue", "green", "orange", "vermilion", "purple", "sky")
STROKES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)))


@dataclass(frozen=True)
class Line:
    """epsilon (k,) at the last increment at distances (k,), mm, from a rim. where: in words."""

    where: str
    distance: Array
    epsilon: Array

    def half_length(self) -> float:
        """Distance from the rim, mm, where epsilon is first half of its largest value within `NEAR_HOLE` of the rim."""
        near = np.flatnonzero(self.distance <= NEAR_HOLE)
        peak = int(near[self.epsilon[near].argmax()])
        below = np.flatnonzero(self.epsilon[peak:] <= self.epsilon[peak] / 2)
        return float(self.distance[peak + below[0]] if below.size else self.distance[-1])


@dataclass(frozen=True)
class SolidNumbers:
    """Of one 3D solution: lines from rims outward; forces side to (n_inc,), N, along the pull, of the whole arm."""

    lines: list[Line]
    forces: dict[str, Array]


@dataclass(frozen=True)
class ThicknessResults(Results):
    """A finished thickness study."""

    @property
    def thicknesses(self) -> list[str]:
        """Thicknesses as in file names, thinnest first."""
        return [h for h in self.settings.thicknesses if h != PLANE]

    @property
    def conditions(self) -> list[str]:
        """The 2D reference and every thickness."""
        return [PLANE, *self.thicknesses]

    def fitted(self, condition: str, loss: Loss, noisy: bool) -> dict[Case, Fit]:
        """Fits of a condition: of clean data (one), or of all noise seeds.

        A correction for the thickness leaves the 2D reference as it is.
        """
        if condition == PLANE and loss is Loss.CORRECTED and Loss.CORRECTED in self.losses:
            loss = Loss.WEIGHTED
        return self.fits(loss, noisy, thickness=condition)

    @cached_property
    def plane(self) -> SurfaceSolution:
        """The 2D plane-stress solution of the quarter, 1 mm thick."""
        return read(self._file("forward", PLANE), SurfaceSolution.load)

    @cached_property
    def fields(self) -> dict[str, EpsilonField]:
        """epsilon by thickness."""
        return {h: read(self._file("epsilon", h), EpsilonField.load) for h in self.thicknesses}

    @cached_property
    def states(self) -> States:
        """Deformation states of the 2D reference, all increments."""
        return read(self.folder / "states" / f"{SPECIMEN}.npz", States.load)

    @property
    def limit(self) -> float:
        """Upper end of the calibrated range of I1, the same for all conditions."""
        return self.cases[0].calibrated_I1

    @cached_property
    def reference(self) -> Reference:
        """The truth at the states within the calibrated range."""
        return Reference.at(self.states.within(self.limit))

    def solid(self, thickness: str) -> SolidSolution:
        """The 3D solution of a thickness; large, so it is read anew each time."""
        return read(self._file("solids", thickness), SolidSolution.load)

    @cached_property
    def numbers(self) -> dict[str, SolidNumbers]:
        """What every 3D solution says in a few numbers."""
        places = [(where, d, locate(self.plane.mesh, points)) for where, d, points in lines()]
        return {name: solid_numbers(self.solid(name), self.plane, places) for name in self.thicknesses}

    def inputs(self) -> list[Path]:
        """Files that the report is made of."""
        solids = [self._file(kind, h) for kind in ("solids", "epsilon") for h in self.thicknesses]
        plane = [self._file("forward", PLANE), self.folder / "states" / f"{SPECIMEN}.npz"]
        return [*plane, *solids, *super().inputs()]

    def _file(self, kind: str, condition: str) -> Path:
        return self.folder / kind / f"{SPECIMEN}_{condition}.npz"

    def look(self, condition: str) -> dict[str, Any]:
        """Colour and line of a condition, the same in every figure."""
        if condition == PLANE:
            return {"color": style.COLOURS["black"], "linestyle": "-", "linewidth": 1.0}
        i = self.thicknesses.index(condition) % len(SHADES)
        return {"color": style.COLOURS[SHADES[i]], "linestyle": STROKES[i]}


def condition_name(condition: str) -> str:
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
    surface = solid.displacements[-1, -len(plane.points) :]
    found = []
    for where, distance, place in places:
        F_plane = np.eye(2) + gradients_at(plane.mesh, place, plane.displacements[-1])
        F_solid = np.eye(3)[:, :2] + gradients_at(plane.mesh, place, surface)
        found.append(Line(where, distance, difference(F_plane, F_solid)))
    return SolidNumbers(found, arm_forces(solid.reactions))


def arm_forces(reactions: dict[str, Array]) -> dict[str, Array]:
    """Force along the pull of each whole arm, N, from the reactions of a quarter (half an arm each)."""
    return {side: 2 * np.asarray(reactions[side])[:, axis] for side, axis in (("right", 0), ("top", 1))}


def hole_edge(mesh: Any) -> float:
    """Mean length, mm, of the edges on the rims of holes, as the mesh has them and not as they were asked for."""
    rims = np.concatenate([edges for name, edges in mesh.boundaries.items() if name.startswith("hole_")])
    return float(np.linalg.norm(mesh.points[rims[:, 1]] - mesh.points[rims[:, 0]], axis=1).mean())
