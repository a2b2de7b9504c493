"""A solved experiment on a solid: displacements, pressures and reactions of each increment; its surface and a file.

Needs no finite-element package.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forward import interpolation
from forward.solution import SurfaceSolution
from forward.solution_file import read_solution, write_solution
from meshes import Mesh
from meshes.extrusion import HEX_NODES, SolidMesh, hex_shape_gradients

Array = NDArray[np.float64]
FORMAT = "equigap-solid"
CENTRE = int(np.flatnonzero((HEX_NODES == 0).all(axis=1))[0])
OWN = ("levels", "symmetric", "pressure", "bulk_modulus")


@dataclass(frozen=True, eq=False)
class SolidSolution:
    """Equilibrium states of a solid.

    mesh: triquadratic hexes; displacements (n_inc, n, 3), mm; pressure (n_inc, m, 4): p = q0 + q . (X - Xc) in each
    hex, Xc its centre node, q0 in MPa, the others in MPa/mm; reactions: side to (n_inc, 3), the force of the grip
    on the specimen, N, of the whole thickness (of half an arm where the plane mesh is a quarter); time (n_inc,):
    load factor; energy (n_inc,) of the meshed part, N mm; iterations (n_inc,): linear solves; bulk_modulus, MPa;
    description: material, loading, program versions.
    """

    mesh: SolidMesh
    displacements: Array
    pressure: Array
    reactions: dict[str, Array]
    time: Array
    energy: Array
    iterations: NDArray[np.int64]
    bulk_modulus: float
    description: dict[str, Any] = field(default_factory=dict)

    @property
    def thickness(self) -> float:
        """Of the whole specimen, mm."""
        return self.mesh.thickness

    @property
    def unknowns(self) -> tuple[Array, ...]:
        """Displacements and pressures, for a run that goes on."""
        return self.displacements, self.pressure

    @property
    def history(self) -> dict[str, Array]:
        """No state variables: the solid is elastic."""
        return {}

    @property
    def readings(self) -> dict[str, Array]:
        """None on the way to the increments."""
        return {}

    def surface(self) -> SurfaceSolution:
        """What a camera above sees: the in-plane displacements of the upper surface, with the grips' forces."""
        n = len(self.mesh.plane.points)
        return SurfaceSolution(
            mesh=self.mesh.plane,
            displacements=self.displacements[:, -n:, :2],
            reactions={side: force[:, :2] for side, force in self.reactions.items()},
            time=self.time,
            energy=self.energy * (2 if self.mesh.symmetric else 1),
            iterations=self.iterations,
            thickness=self.thickness,
            description=self.description,
        )

    def surface_gauss(self) -> tuple[Array, Array, Array]:
        """Places (k, 2), mm, and weights (k,), mm^2, of the Gauss points of the surface, and F there, (n_inc, k, 3, 3).

        The points are those of `SurfaceSolution.gauss` on the same plane mesh.
        """
        _, points, weights = interpolation.gauss_points(self.mesh.plane)
        x, _ = np.polynomial.legendre.leggauss(3)
        local = np.array([(a, b, 1.0) for b in x for a in x])
        top = self.mesh.cells[-len(self.mesh.plane.cells) :]
        gradients = self._gradients(top, local)
        return points, weights, (np.eye(3) + gradients).reshape(len(self.displacements), -1, 3, 3)

    def _gradients(self, cells: NDArray[np.int64], local: Array) -> Array:
        """du/dX (n_inc, k, q, 3, 3) at local places (q, 3) of hexes (k, 27)."""
        reference = hex_shape_gradients(local)
        J = np.einsum("qnk,mni->mqik", reference, self.mesh.points[cells])
        slopes = np.einsum("qnk,mqkj->mqnj", reference, np.linalg.inv(J))
        return np.stack([np.einsum("mqnj,mni->mqij", slopes, u[cells]) for u in self.displacements])

    def save(self, path: str | Path) -> None:
        """Write a .npz atomically. Raises `MeshDataError` where it cannot be written."""
        own = {"pressure": self.pressure, "bulk_modulus": self.bulk_modulus}
        write_solution(
            path, FORMAT, self, self.mesh.plane, levels=self.mesh.levels, symmetric=self.mesh.symmetric, **own
        )

    @classmethod
    def load(cls, path: str | Path) -> SolidSolution:
        """Read what `save` wrote. Raises `SolutionError`."""
        arguments, content = read_solution(path, FORMAT, OWN, _mesh)
        return cls(**arguments, pressure=content["pressure"], bulk_modulus=float(content["bulk_modulus"]))


def _mesh(plane: Mesh, content: dict[str, Any]) -> SolidMesh:
    return SolidMesh(plane, content["levels"], bool(content["symmetric"]))
