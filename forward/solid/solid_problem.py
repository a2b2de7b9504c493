"""The three-dimensional boundary value problem: mesh, energy and supports in; equilibrium at a load out.

Triquadratic displacement u and, in each hex, a linear pressure p in a perturbed Lagrangian: with the isochoric
invariants I1 and I2 the potential is int psi(I1, I2) + p (J - 1) - p^2 / (2 kappa) dV. Its Newton step is
condensed hex by hex to the displacements (`element.c`); the pressure is kept and moves with them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forward._dolfinx import MPI, basix, dolfinx, ufl
from forward.compilation import compiled_form
from forward.errors import LinearSolverError
from forward.materials import Material
from forward.solid.element import PRESSURES, Solid
from forward.solid.linear_solver import LinearSolver
from forward.solid.mumps import Mumps
from forward.solid.pardiso import Pardiso, pardiso_installed
from forward.solid.solid_forms import centre_function, potential, pressure_basis
from forward.stepping import Elastic, Unknowns
from meshes.extrusion import HEX_NODES, SolidMesh
from meshes.mesh import Array

SOLVERS = ("fastest", "pardiso", "mumps")
SHORTEST_STEP = 1 / 16
FAR = 3e-4  # imbalance above which a Newton step changes the tangent so much that a kept factor serves badly
GROWTH = 1e3  # of the imbalance in one Newton step; a step that errs by more is shortened


@dataclass(frozen=True)
class Outcome:
    """How a Newton solve ended: converged or not, linear solves it took, text for the user."""

    converged: bool
    iterations: int
    text: str


@dataclass(frozen=True)
class _Imbalance:
    """Nodal forces (n, 3), N; free: norm at free nodes over norm at held ones; volume: rms of J - 1 - p / kappa."""

    forces: Array
    free: float
    volume: float
    inverted: int

    @property
    def admissible(self) -> bool:
        return self.inverted == 0 and bool(np.isfinite(self.free) and np.isfinite(self.volume))


class SolidProblem(Elastic):
    """Displacement u and pressure p of a solid whose components `held` (n, 3) move to load * `values` (n, 3), mm.

    bulk_modulus: MPa. Raises `LinearSolverError` for a solver that is unknown or not there.
    """

    def __init__(
        self,
        mesh: SolidMesh,
        material: Material,
        bulk_modulus: float,
        held: NDArray[np.bool_],
        values: Array,
        tolerance: float,
        volume_tolerance: float,
        max_iterations: int,
        solver: str = "fastest",
        comm: Any = MPI.COMM_WORLD,
    ) -> None:
        self.mesh, self.comm = mesh, comm
        self.tolerance, self.volume_tolerance, self.max_iterations = tolerance, volume_tolerance, max_iterations
        self.domain = create_domain(mesh, comm)
        self.V = dolfinx.fem.functionspace(self.domain, ("Lagrange", 2, (3,)))
        self.solid = Solid(self.domain, self.V.dofmap.list, node_order(), material, bulk_modulus)
        self.nodes, self.cells = self._nodes(), self._cells()
        self.held, self.values = held[self.nodes], np.ascontiguousarray(values[self.nodes])
        self.volume = self._sum(mesh.volume() * self.solid.n_cells / len(mesh.cells))
        self.linear = self._linear_solver(solver)
        self._vector = dolfinx.la.vector(self.V.dofmap.index_map, 3)
        self._fields, self._energy = self._energy_form(material, bulk_modulus)
        # what counts as no force at all, N: of a strain of 1e-9
        self._least_force = 1e-9 * material.shear_modulus * float(np.ptp(mesh.points, axis=0).max()) ** 2
        self.u = np.zeros((len(self.nodes), 3))
        self.q = np.zeros((self.solid.n_cells, PRESSURES))

    @property
    def unknowns(self) -> Unknowns:
        """Displacements (n, 3), mm, and pressure coefficients (m, 4), MPa and MPa/mm, in the order of the mesh, on
        every rank."""
        u = np.zeros(self.mesh.points.shape)
        owned = self.V.dofmap.index_map.size_local
        u[self.nodes[:owned]] = self.u[:owned]
        q = np.zeros((len(self.mesh.cells), PRESSURES))
        q[self.cells] = self.q
        return self._everywhere(u), self._everywhere(q)

    @unknowns.setter
    def unknowns(self, values: Unknowns) -> None:
        """Take displacements (n, 3), mm, and pressure coefficients (m, 4)."""
        self.u = np.ascontiguousarray(values[0][self.nodes])
        self.q = np.ascontiguousarray(values[1][self.cells])

    def solve(self, load_factor: float) -> Outcome:
        """Newton's method from the present unknowns. The caller checks the outcome and rolls back if need be."""
        now = self._imbalance(self.u, self.q)
        if not now.admissible:
            return Outcome(False, 0, "the prediction turns a hex inside out")
        for iteration in range(self.max_iterations + 1):
            jump = np.where(self.held, load_factor * self.values - self.u, 0.0)
            moving = self._max(np.abs(jump).max(initial=0.0)) > 1e-12
            if not moving and now.free <= self.tolerance and now.volume <= self.volume_tolerance:
                return Outcome(True, iteration, "converged")
            if iteration == self.max_iterations:
                break
            du = self.linear.step(self.u, self.q, jump, fresh=iteration == 0 or now.free > FAR)
            if self._max(float(du is None)):
                return Outcome(False, iteration + 1, "the tangent could not be factorised")
            assert du is not None
            dq = self.solid.pressure_step(self.u, self.q, du)
            length = 1.0
            while True:
                u, q = self.u + length * du, self.q + length * dq
                trial = self._imbalance(u, q)
                if trial.admissible and (moving or self._merit(trial) <= GROWTH * self._merit(now)):
                    break
                length /= 2
                if length < SHORTEST_STEP:
                    why = "a hex would be turned inside out" if trial.inverted else "the imbalance grows"
                    return Outcome(False, iteration + 1, why)
            self.u, self.q, now = u, q, trial
        return Outcome(False, self.max_iterations, f"not converged in {self.max_iterations} iterations")

    def nodal_forces(self) -> Array:
        """Internal forces (n, 3), N, on every rank: what grips exert on held nodes, zero at free ones."""
        forces = self._imbalance(self.u, self.q).forces
        full = np.zeros(self.mesh.points.shape)
        owned = self.V.dofmap.index_map.size_local
        full[self.nodes[:owned]] = forces[:owned]
        return self._everywhere(full)

    def energy(self) -> float:
        """Stored energy of what is meshed, N mm."""
        u, q = self._fields
        u.x.array[:] = self.u.ravel()
        q.x.array.reshape(-1, PRESSURES)[q.function_space.dofmap.list[: self.solid.n_cells, 0]] = self.q
        return self._sum(float(dolfinx.fem.assemble_scalar(self._energy)))

    def _energy_form(self, material: Material, kappa: float) -> tuple[Any, Any]:
        u = dolfinx.fem.Function(self.V)
        q = dolfinx.fem.Function(dolfinx.fem.functionspace(self.domain, ("DG", 0, (PRESSURES,))))
        centres = centre_function(self.domain, np.argsort(node_order()))
        parameters = dolfinx.fem.Constant(self.domain, np.array(material.parameters))
        p = ufl.dot(q, pressure_basis(self.domain, centres))
        bulk_modulus = dolfinx.fem.Constant(self.domain, float(kappa))
        form = potential(u, p, material, parameters, bulk_modulus, self.domain)
        return (u, q), compiled_form(form)

    def _imbalance(self, u: Array, q: Array) -> _Imbalance:
        forces, volume, inverted = self.solid.forces(u, q)
        self._vector.array[:] = forces.ravel()
        self._vector.scatter_reverse(dolfinx.la.InsertMode.add)
        owned = self.V.dofmap.index_map.size_local
        forces = self._vector.array.reshape(-1, 3).copy()
        squares, held = forces[:owned] ** 2, self.held[:owned]
        sums = self._everywhere(np.array([squares[~held].sum(), squares[held].sum(), volume, float(inverted)]))
        free = np.sqrt(sums[0]) / max(np.sqrt(sums[1]), self._least_force)
        return _Imbalance(forces, float(free), float(np.sqrt(sums[2] / self.volume)), int(sums[3]))

    def _merit(self, imbalance: _Imbalance) -> float:
        return max(imbalance.free / self.tolerance, imbalance.volume / self.volume_tolerance, 1.0)

    def _linear_solver(self, name: str) -> LinearSolver:
        if name not in SOLVERS:
            raise LinearSolverError(f"solver '{name}' is unknown; choose one of {', '.join(SOLVERS)}")
        possible = self.comm.size == 1 and pardiso_installed()
        if name == "pardiso" and not possible:
            raise LinearSolverError(
                "PARDISO needs the package pypardiso and a single rank; choose 'mumps' or 'fastest'"
            )
        if name != "mumps" and possible:
            return Pardiso(self.solid, len(self.nodes), self.held)
        return Mumps(self.solid, self.V, self.held)

    def _nodes(self) -> NDArray[np.int64]:
        """Mesh node of each local block, ghosts included."""
        index_map = self.V.dofmap.index_map
        nodes = np.zeros(index_map.size_local + index_map.num_ghosts, np.int64)
        geometry = self.domain.geometry
        nodes[self.V.dofmap.list] = np.asarray(geometry.input_global_indices)[np.asarray(geometry.dofmaps[0])]
        return nodes

    def _cells(self) -> NDArray[np.int64]:
        """Mesh cell of each owned cell."""
        return np.asarray(self.domain.topology.original_cell_index)[: self.solid.n_cells]

    def _everywhere(self, values: Array) -> Array:
        """Sum over the ranks."""
        result = np.ascontiguousarray(values)
        self.comm.Allreduce(MPI.IN_PLACE, result, op=MPI.SUM)
        return result

    def _sum(self, value: float) -> float:
        return float(self.comm.allreduce(value, op=MPI.SUM))

    def _max(self, value: float) -> float:
        return float(self.comm.allreduce(value, op=MPI.MAX))


def create_domain(mesh: SolidMesh, comm: Any) -> Any:
    """DOLFINx mesh of triquadratic hexes, spread over the ranks; rank 0 gives the arrays."""
    element = basix.ufl.element("Lagrange", "hexahedron", 2, shape=(3,))
    first = comm.rank == 0
    cells = mesh.cells[:, node_order()] if first else np.empty((0, 27), np.int64)
    points = mesh.points if first else np.empty((0, 3))
    return dolfinx.mesh.create_mesh(comm, cells, element, points)


def node_order() -> NDArray[np.int64]:
    """For each node of DOLFINx's hex its number in the mesh's hex."""
    points = basix.ufl.element("Lagrange", "hexahedron", 2).basix_element.points * 2 - 1
    return np.array([int(np.flatnonzero((np.abs(HEX_NODES - x) < 1e-9).all(axis=1))[0]) for x in points])
