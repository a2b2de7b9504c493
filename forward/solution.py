"""A solved experiment as a camera sees it: displacements of a surface and reactions of each increment.

A thin sheet is its surface; a solid gives its own (`SolidSolution.surface`).

Needs no finite-element package.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forward import interpolation
from forward.errors import SolutionError
from forward.solution_file import read_solution, write_solution
from meshes import Mesh
from meshes.errors import MeshDataError
from meshes.files import with_prefix

Array = NDArray[np.float64]
FORMAT = "equigap-surface"


@dataclass(frozen=True, eq=False)
class SurfaceSolution:
    """Equilibrium states of a sheet, or of the surface of a solid.

    mesh: biquadratic quads; displacements (n_inc, n, 2) at its nodes, mm; reactions: side to (n_inc, 2), the force of
    the grip on the specimen, N; time (n_inc,): load factor, 1 at the end, or s of a history; energy (n_inc,): stored, N
    mm; iterations (n_inc,) of the solver; thickness, mm; description: material, loading, program versions; history:
    state variables (m, 9, ...) at the Gauss points after the last increment, by name, of a sheet that has some; readings: side to
    (r, 2), N, of a load cell on the way to the increments, at reading_times (r,), s, where some were asked for.
    """

    mesh: Mesh
    displacements: Array
    reactions: dict[str, Array]
    time: Array
    energy: Array
    iterations: NDArray[np.int64]
    thickness: float
    description: dict[str, Any] = field(default_factory=dict)
    history: dict[str, Array] = field(default_factory=dict)
    readings: dict[str, Array] = field(default_factory=dict)
    reading_times: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def unknowns(self) -> tuple[Array, ...]:
        """The displacements, for a run that goes on."""
        return (self.displacements,)

    @property
    def points(self) -> Array:
        """Nodes (n, 2), mm."""
        return self.mesh.points

    @property
    def cells(self) -> NDArray[np.int64]:
        """Nodes of each cell (m, 9) or (m, 6), in the order of `meshes.elements`."""
        return self.mesh.cells

    def evaluate(self, points: Array) -> Array:
        """Displacements (n_inc, k, 2), mm, at reference points (k, 2), mm. Raises `SolutionError` far outside."""
        return interpolation.values_at(self.mesh, interpolation.locate(self.mesh, points), self.displacements)

    def deformation_gradient(self, points: Array) -> Array:
        """In-plane deformation gradient (n_inc, k, 2, 2) at reference points (k, 2), mm. Raises `SolutionError` far
        outside."""
        places = interpolation.locate(self.mesh, points)
        return np.eye(2) + interpolation.gradients_at(self.mesh, places, self.displacements)

    def gauss(self) -> tuple[Array, Array, Array]:
        """Gauss points of all cells: places (k, 2), mm, weights (k,), mm^2, and the in-plane deformation
        gradient there, (n_inc, k, 2, 2)."""
        slopes, points, weights = interpolation.gauss_points(self.mesh)
        gradients = np.einsum("mqnj,tmni->tmqij", slopes, self.displacements[:, self.mesh.cells])
        return points, weights, (np.eye(2) + gradients).reshape(len(self.displacements), -1, 2, 2)

    def mirrored(self) -> SurfaceSolution:
        """The full specimen of a quarter. Raises `SolutionError` if this is not a quarter.

        A quarter's side carries half the arm's force; the transverse force of the arm vanishes by symmetry.
        """
        try:
            mesh, source, signs = self.mesh.mirrored()
        except MeshDataError as error:
            raise SolutionError(f"cannot mirror: {error}") from error
        reactions: dict[str, Array] = {}
        for side, opposite, axis in (("right", "left", 0), ("top", "bottom", 1)):
            if side in self.reactions:
                force = np.zeros_like(self.reactions[side])
                force[:, axis] = 2 * self.reactions[side][:, axis]
                reactions |= {opposite: -force, side: force}
        displacements = self.displacements[:, source] * signs
        description = {**self.description, "mirrored": True}
        return SurfaceSolution(
            mesh,
            displacements,
            reactions,
            self.time,
            4 * self.energy,
            self.iterations,
            self.thickness,
            description,
        )

    def save(self, path: str | Path) -> None:
        """Write a .npz atomically. Raises `MeshDataError` where it cannot be written."""
        more = {f"history_{name}": values for name, values in self.history.items()}
        more |= {f"reading_{name}": values for name, values in self.readings.items()}
        if self.readings:
            more["reading_times"] = self.reading_times
        write_solution(path, FORMAT, self, self.mesh, thickness=self.thickness, **more)

    @classmethod
    def load(cls, path: str | Path) -> SurfaceSolution:
        """Read what `save` wrote. Raises `SolutionError`."""
        arguments, content = read_solution(path, FORMAT, ("thickness",), lambda plane, _: plane)
        times = content.pop("reading_times", np.zeros(0))
        return cls(
            **arguments, thickness=float(content["thickness"]), history=with_prefix(content, "history_"),
            readings=with_prefix(content, "reading_"), reading_times=times,
        )  # fmt: skip
