"""The plane-stress boundary value problem in DOLFINx: mesh, energy and supports in; equilibrium at a load out.

Total Lagrangian, biquadratic quads with 3 x 3 Gauss points, or quadratic triangles with seven. The sheet is incompressible and thin: F33 = 1 / det F,
which leaves no pressure (it follows from P33 = 0). With C2 the in-plane right Cauchy-Green tensor,
I1 = tr C2 + 1 / det C2 and I2 = det C2 + tr C2 / det C2, and the energy of the sheet is h int psi(I1, I2) dA.
Forces and tangent are its first and second derivative, so the tangent is symmetric.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forward._dolfinx import MPI, QUADRATURE_DEGREE, PETSc, basix, dolfinx, ufl
from forward.compilation import compiled_form, compiled_problem
from forward.loading import moved
from forward.materials import Material
from forward.stepping import Elastic
from meshes import Mesh

Array = NDArray[np.float64]
Invariants = tuple[Any, Any]  # I1, I2

CELLS = {"quad": "quadrilateral", "triangle6": "triangle"}  # DOLFINx's names
# Node order of a cell in DOLFINx (quad: tensor product; triangle: edges opposite of the corners), in numbers of the mesh's order.
DOLFINX_NODES = {"quad": [0, 1, 3, 2, 4, 7, 5, 6, 8], "triangle6": [0, 1, 2, 4, 5, 3]}
PETSC_OPTIONS = {
    "snes_type": "newtonls",
    "snes_linesearch_type": "bt",
    "snes_lag_jacobian": 2,  # a factor serves two iterations: it costs five times what the residual does
    "ksp_type": "preonly",
    "pc_type": "cholesky",
    "pc_factor_mat_solver_type": "mumps",
}
NOT_A_NUMBER = -4  # PETSc's reason; its name changes between versions
_numbers = count()


@dataclass(frozen=True)
class Outcome:
    """How a Newton solve ended: reason (PETSc's, > 0 is converged), iterations, text for the user."""

    reason: int
    iterations: int
    text: str

    @property
    def converged(self) -> bool:
        """Whether it ended in equilibrium."""
        return self.reason > 0


@dataclass(frozen=True)
class _Support:
    """Dirichlet condition of one component: the function it reads, its dofs there, their values (m,) or (k, m), mm, see `moved`."""

    bc: Any
    target: Any
    dofs: NDArray[np.int32]
    values: Array


def invariants(F: Any) -> tuple[Any, Any]:
    """I1 and I2 in UFL of an incompressible sheet with the in-plane deformation gradient F."""
    C = F.T * F
    det_C, tr_C = ufl.det(F) ** 2, ufl.tr(C)
    return tr_C + 1 / det_C, det_C + tr_C / det_C


def to_second_order(energy: Callable[[Any, Any], Any], at: Invariants, present: Invariants) -> Any:
    """The energy and its first and second derivative where invariants `at` are the present ones, in UFL: a polynomial of second degree, whose
    derivatives by u cost little. Those of a spline of thirty pieces, each by the chain rule, took fifteen times as long as its forces (`docs/cost.md`)."""
    I = tuple(ufl.variable(one) for one in present)
    psi = energy(*I)
    slopes, steps = [ufl.diff(psi, one) for one in I], [a - b for a, b in zip(at, present, strict=True)]
    found = psi
    for slope, step in zip(slopes, steps, strict=True):
        found = found + slope * step
        for other, by in zip(I, steps, strict=True):
            found = found + ufl.diff(slope, other) / 2 * step * by
    return found


def stored_energy(u: Any, material: Material, domain: Any, thickness: float) -> Any:
    """UFL form of the stored energy, N mm; parameters are constants, so that its compiled code is reused."""
    parameters = dolfinx.fem.Constant(domain, np.array(material.parameters))
    h = dolfinx.fem.Constant(domain, float(thickness))
    dx = ufl.dx(domain=domain, metadata={"quadrature_degree": QUADRATURE_DEGREE})
    F = ufl.Identity(2) + ufl.grad(u)
    return h * material.energy(*invariants(F), parameters) * dx


def create_domain(mesh: Mesh, comm: Any) -> Any:
    """DOLFINx mesh of quads or triangles of six nodes, spread over the ranks; rank 0 gives the arrays."""
    element = basix.ufl.element("Lagrange", CELLS[mesh.cell_type], 2, shape=(2,))
    first, order = comm.rank == 0, DOLFINX_NODES[mesh.cell_type]
    cells = mesh.cells[:, order] if first else np.empty((0, len(order)), np.int64)
    points = mesh.points if first else np.empty((0, 2))
    return dolfinx.mesh.create_mesh(comm, cells, element, points)


def weakly(method: Callable[..., Any]) -> Callable[..., Any]:
    """A bound method that PETSc may keep: a solver that holds its owner is never freed, nor its communicators, of which MPICH has
    2046 and a solve takes 15."""
    reference = weakref.WeakMethod(method)

    def call(*arguments: Any) -> Any:
        found = reference()
        assert found is not None  # the owner also owns the solver
        return found(*arguments)

    return call


class PlaneStressProblem(Elastic):
    """Displacement u of a sheet whose components `held` (n, 2) move by `values`, mm: (n, 2) or (k, n, 2), see `forward.loading.moved`."""

    symmetric = True  # the tangent

    def __init__(
        self,
        mesh: Mesh,
        material: Any,
        thickness: float,
        held: NDArray[np.bool_],
        values: Array,
        tolerance: float,
        max_iterations: int,
        comm: Any = MPI.COMM_WORLD,
    ) -> None:
        self.mesh, self.comm, self.tolerance, self.max_iterations = mesh, comm, tolerance, max_iterations
        self.domain = create_domain(mesh, comm)
        self.V = dolfinx.fem.functionspace(self.domain, ("Lagrange", 2, (2,)))
        self.u = dolfinx.fem.Function(self.V)
        self.nodes = self._nodes()
        self.supports = self._make_supports(held, values)
        energy, forces, tangent = self._forms(material, thickness)
        self._energy = compiled_form(energy)
        self.problem = compiled_problem(
            forces,
            self.u,
            bcs=[support.bc for support in self.supports],
            petsc_options_prefix=f"plane_stress_{next(_numbers)}_",
            J=tangent,
            petsc_options=PETSC_OPTIONS if self.symmetric else {**PETSC_OPTIONS, "pc_type": "lu"},
        )
        self._prepare_factorisation()
        self._raw = self.problem.b.duplicate()
        self._is_held = self._held_entries()
        self.problem.solver.setConvergenceTest(weakly(self._test))

    @property
    def displacements(self) -> Array:
        """Displacements (n, 2) at the mesh's nodes, mm, on every rank."""
        return self._gather(self.u.x.array)

    @property
    def unknowns(self) -> tuple[Array, ...]:
        """The displacements (n, 2), mm, for the load stepping."""
        return (self.displacements,)

    @unknowns.setter
    def unknowns(self, values: tuple[Array, ...]) -> None:
        """Take displacements (n, 2), mm."""
        self.u.x.array[:] = values[0][self.nodes].ravel()

    def solve(self, load_factor: float) -> Outcome:
        """Newton's method from the present u; `load_factor`: of `values`. The caller checks the outcome and rolls u
        back if need be."""
        for support in self.supports:
            support.target.x.array[support.dofs] = moved(support.values, load_factor)
        self.problem.solve()
        solver = self.problem.solver
        reason, iterations = solver.getConvergedReason(), solver.getIterationNumber()
        if reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:  # PETSc would solve with the factor that failed
            solver.getKSP().getPC().reset()
            self._prepare_factorisation()
        if reason > 0 and not self._admissible():
            return Outcome(PETSc.SNES.ConvergedReason.DIVERGED_FUNCTION_DOMAIN, iterations, "det F <= 0")
        return Outcome(reason, iterations, REASONS.get(reason, f"reason {reason}"))

    def nodal_forces(self) -> Array:
        """Internal forces (n, 2), N, on every rank: what grips exert on held nodes, zero at free ones."""
        self._assemble_raw()
        local = np.zeros_like(self.u.x.array)
        local[: self._raw.getLocalSize()] = self._raw.getArray(readonly=True)
        return self._gather(local)

    def energy(self) -> float:
        """Stored energy, N mm."""
        return float(self.comm.allreduce(dolfinx.fem.assemble_scalar(self._energy), op=MPI.SUM))

    def _forms(self, material: Material, thickness: float) -> tuple[Any, Any, Any]:
        """UFL forms of stored energy, nodal forces and tangent; None: the derivative of the forces."""
        energy = stored_energy(self.u, material, self.domain, thickness)
        return energy, ufl.derivative(energy, self.u, ufl.TestFunction(self.V)), None

    def _nodes(self) -> NDArray[np.int64]:
        """Mesh node of each local dof block: the displacement and the geometry are both quadratic."""
        nodes = np.zeros(self.V.dofmap.index_map.size_local + self.V.dofmap.index_map.num_ghosts, np.int64)
        geometry = self.domain.geometry
        nodes[self.V.dofmap.list] = np.asarray(geometry.input_global_indices)[np.asarray(geometry.dofmaps[0])]
        return nodes

    def _make_supports(self, held: NDArray[np.bool_], values: Array) -> list[_Support]:
        """Dirichlet conditions of x and y."""
        supports = []
        for axis in range(2):
            V_axis, to_V = self.V.sub(axis).collapse()
            to_V = np.concatenate([np.ravel(part) for part in to_V]).astype(np.int32)
            nodes = self.nodes[to_V // 2]
            dofs = np.flatnonzero(held[nodes, axis]).astype(np.int32)
            target = dolfinx.fem.Function(V_axis)
            bc = dolfinx.fem.dirichletbc(target, [to_V[dofs], dofs], self.V.sub(axis))
            supports.append(_Support(bc, target, dofs, values[..., nodes[dofs], axis]))
        return supports

    def _held_entries(self) -> NDArray[np.int32]:
        """Owned entries of the residual that belong to supports."""
        entries = []
        for support in self.supports:
            dofs, owned = support.bc.dof_indices()
            entries.append(dofs[:owned])
        return np.concatenate(entries)

    def _prepare_factorisation(self) -> None:
        """Tell PETSc whether the tangent is symmetric, and give MUMPS spare memory for pivoting, %."""
        self.problem.A.setOption(PETSc.Mat.Option.SYMMETRIC, self.symmetric)
        linear_solver = self.problem.solver.getKSP()
        linear_solver.setOperators(self.problem.A)
        linear_solver.getPC().setFactorSetUpSolverType()
        linear_solver.getPC().getFactorMatrix().setMumpsIcntl(14, 60)

    def _assemble_raw(self) -> None:
        """Internal forces without regard to the supports."""
        with self._raw.localForm() as local:
            local.set(0.0)
        dolfinx.fem.petsc.assemble_vector(self._raw, self.problem.F)
        self._raw.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)

    def _test(self, solver: Any, iteration: int, norms: tuple[float, float, float]) -> int:
        """Converged when the imbalance is below `tolerance` times the norm of the nodal reactions."""
        reasons = PETSc.SNES.ConvergedReason
        imbalance = norms[2]
        if not np.isfinite(imbalance):
            return NOT_A_NUMBER
        self._assemble_raw()
        reactions = self._raw.getArray(readonly=True)[self._is_held]
        scale = np.sqrt(self.comm.allreduce(float(reactions @ reactions), op=MPI.SUM))
        if imbalance <= self.tolerance * scale or imbalance == 0:
            return reasons.CONVERGED_FNORM_RELATIVE
        if iteration >= self.max_iterations:
            return reasons.DIVERGED_MAX_IT
        return reasons.ITERATING

    def _admissible(self) -> bool:
        """Finite displacements, and no cell turned inside out."""
        u = self.displacements
        if not np.isfinite(u).all():
            return False
        deformed = Mesh(self.mesh.points + u, self.mesh.cells, self.mesh.cell_type, {})
        return bool(deformed.quality.min() > 0)

    def _gather(self, local: Array) -> Array:
        """Owned entries of a vector (all ranks) as (n, 2) in the order of the mesh."""
        owned = self.V.dofmap.index_map.size_local
        full = np.zeros(self.mesh.points.shape)
        full[self.nodes[:owned]] = local.reshape(-1, 2)[:owned]
        self.comm.Allreduce(MPI.IN_PLACE, full, op=MPI.SUM)
        return full


REASONS = {
    value: name.replace("_", " ").lower()
    for name, value in vars(PETSc.SNES.ConvergedReason).items()
    if isinstance(value, int) and name.isupper()
}
