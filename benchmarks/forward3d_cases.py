"""One case of `forward3d.py` in a process of its own: settings as JSON in, times, memory and forces as JSON out.

`monolithic` is the same weak form as ours in UFL for DOLFINx's own `NonlinearProblem`: displacement and pressure in
one matrix, LU by MUMPS. Hexes, Gauss points, compiler flags, load stepping, predictor and tolerances are ours. Not
ours: a Newton step that errs is not shortened, and the forces are assembled once more to test convergence.
"""
# ruff: noqa: E402  (the number of threads must be set before anything numerical is imported)

from __future__ import annotations

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import json
import resource
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "tests" / "fixtures")]

from forward import ArrudaBoyce, Loading
from forward._dolfinx import MPI, PETSc, dolfinx, ufl
from forward.compilation import compiled_form, compiled_problem
from forward.solid import pardiso
from forward.solid.element import PRESSURES, Solid
from forward.solid.solid_forms import centre_function, potential, pressure_basis
from forward.solid.solid_model import BULK_TO_SHEAR, Options, solve
from forward.solid.solid_problem import Outcome, SolidProblem, create_domain, node_order
from forward.stepping import REST, Elastic, State, proportional, steps
from meshes import Cross, quads
from meshes.extrusion import SolidMesh, extrude

THICKNESS = 10.0
MATERIAL = ArrudaBoyce()
BLR_ACCURACY = 1e-8
KAPPA = BULK_TO_SHEAR * MATERIAL.shear_modulus
PETSC_OPTIONS = {
    "snes_type": "newtonls",
    "snes_linesearch_type": "none",
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
}


class Monolithic(Elastic):
    """Displacement u and pressure q of the solid in one Newton step, for the load stepping. One rank."""

    def __init__(self, mesh: SolidMesh, held: np.ndarray, values: np.ndarray, options: Options) -> None:
        self.options, self.volume = options, mesh.volume()
        domain = create_domain(mesh, MPI.COMM_WORLD)
        V = dolfinx.fem.functionspace(domain, ("Lagrange", 2, (3,)))
        Q = dolfinx.fem.functionspace(domain, ("DG", 0, (PRESSURES,)))
        self.u, self.q = dolfinx.fem.Function(V), dolfinx.fem.Function(Q)
        self.nodes = np.zeros(len(mesh.points), np.int64)
        geometry = domain.geometry
        self.nodes[V.dofmap.list] = np.asarray(geometry.input_global_indices)[np.asarray(geometry.dofmaps[0])]
        self.cells = np.zeros(len(mesh.cells), np.int64)
        self.cells[Q.dofmap.list[:, 0]] = np.asarray(domain.topology.original_cell_index)
        basis = pressure_basis(domain, centre_function(domain, np.argsort(node_order())))
        parameters = dolfinx.fem.Constant(domain, np.array(MATERIAL.parameters))
        kappa = dolfinx.fem.Constant(domain, float(KAPPA))
        energy = potential(self.u, ufl.dot(self.q, basis), MATERIAL, parameters, kappa, domain)
        self._energy = compiled_form(energy)
        forces = [ufl.derivative(energy, x, ufl.TestFunction(x.function_space)) for x in (self.u, self.q)]
        self.supports = [self._support(V, axis, held, values) for axis in range(3)]
        self.problem = compiled_problem(
            forces,
            [self.u, self.q],
            bcs=[bc for bc, *_ in self.supports],
            kind="mpi",
            petsc_options_prefix=f"monolithic_{len(mesh.cells)}_",
            petsc_options=PETSC_OPTIONS,
        )
        squares = ufl.as_vector([b * b for b in basis])
        dx = ufl.dx(metadata={"quadrature_degree": 4})
        self.moments = self._vector(dolfinx.fem.form(ufl.dot(squares, ufl.TestFunction(Q)) * dx))
        self.held = held[self.nodes].ravel()
        self.problem.solver.setConvergenceTest(self._test)

    @property
    def unknowns(self) -> tuple[np.ndarray, ...]:
        u, q = (np.zeros((len(numbers), len(x.x.array) // len(numbers))) for numbers, x in self._fields())
        u[self.nodes], q[self.cells] = self.u.x.array.reshape(u.shape), self.q.x.array.reshape(q.shape)
        return u, q

    @unknowns.setter
    def unknowns(self, values: tuple[np.ndarray, ...]) -> None:
        for (numbers, x), value in zip(self._fields(), values, strict=True):
            x.x.array[:] = value[numbers].ravel()

    def solve(self, load_factor: float) -> Outcome:
        for _, target, dofs, values in self.supports:
            target.x.array[dofs] = load_factor * values
        self.problem.solve()
        snes = self.problem.solver
        reason = snes.getConvergedReason()
        return Outcome(reason > 0, snes.getIterationNumber(), f"SNES reason {reason}")

    def nodal_forces(self) -> np.ndarray:
        forces = np.zeros((len(self.nodes), 3))
        forces[self.nodes] = self._vector(self.problem.F[0]).reshape(-1, 3)
        return forces

    def energy(self) -> float:
        return float(dolfinx.fem.assemble_scalar(self._energy))

    def _fields(self) -> tuple[tuple[np.ndarray, Any], ...]:
        return (self.nodes, self.u), (self.cells, self.q)

    def _vector(self, form: Any) -> np.ndarray:
        return dolfinx.fem.assemble_vector(form).array

    def _support(self, V: Any, axis: int, held: np.ndarray, values: np.ndarray) -> tuple[Any, ...]:
        V_axis, to_V = V.sub(axis).collapse()
        to_V = np.concatenate([np.ravel(part) for part in to_V]).astype(np.int32)
        nodes = self.nodes[to_V // 3]
        dofs = np.flatnonzero(held[nodes, axis]).astype(np.int32)
        target = dolfinx.fem.Function(V_axis)
        bc = dolfinx.fem.dirichletbc(target, [to_V[dofs], dofs], V.sub(axis))
        return bc, target, dofs, values[nodes[dofs], axis]

    def _test(self, snes: Any, iteration: int, norms: tuple[float, float, float]) -> int:
        """The tolerances of `Options`, as `SolidProblem` has them."""
        reasons = PETSc.SNES.ConvergedReason
        if not np.isfinite(norms[2]):
            return -4
        residual, n = snes.getFunction()[0].getArray(readonly=True), self.held.size
        jump = np.abs(residual[:n][self.held]).max()
        free = np.linalg.norm(residual[:n][~self.held])
        scale = np.linalg.norm(self._vector(self.problem.F[0])[self.held])
        volume = np.sqrt((residual[n:] ** 2 / self.moments).sum() / self.volume)
        if jump <= 1e-12 and free <= self.options.tolerance * scale and volume <= self.options.volume_tolerance:
            return reasons.CONVERGED_FNORM_RELATIVE
        return reasons.DIVERGED_MAX_IT if iteration >= self.options.max_iterations else reasons.ITERATING


def loaded(displacement: float) -> Loading:
    return Loading.clamped(Cross.loaded, displacement, 3)


def run_monolithic(mesh: SolidMesh, displacement: float, increments: int) -> dict[str, Any]:
    problem = Monolithic(mesh, *loaded(displacement).on(mesh).prescribed(mesh), Options())
    rest, right = State(REST, problem.unknowns), mesh.boundary_nodes("right")
    found = list(steps(problem, proportional(increments), [rest], Options().max_bisections))
    return {
        "solves": sum(increment.state.iterations for increment in found),
        "forces": [2 * increment.forces[right, 0].sum() for increment in found],
    }


def run_ours(mesh: SolidMesh, displacement: float, increments: int, solver: str = "fastest") -> dict[str, Any]:
    solution = solve(mesh, MATERIAL, loaded(displacement), increments, options=Options(solver=solver))
    return {"solves": int(solution.iterations.sum()), "forces": solution.reactions["right"][:, 0].tolist()}


def run_felupe(mesh: SolidMesh, displacement: float, increments: int) -> dict[str, Any]:
    """No predictor and full Newton steps, as felupe comes; a new PARDISO solver for each matrix."""
    import solid_felupe

    options = {"mapped": False, "tol": Options().tolerance, "verbose": 0}
    result = solid_felupe.solve(mesh, MATERIAL, displacement, increments, KAPPA, **options)
    return {"solves": result.iterations, "forces": [result.right]}


Action = Callable[..., dict[str, Any]]
METHODS: dict[str, Action] = {
    "monolithic": run_monolithic,
    "mumps": partial(run_ours, solver="mumps"),
    "default": run_ours,
    "felupe": run_felupe,
}


def memory(mesh: SolidMesh, displacement: float, increments: int, variant: str) -> dict[str, Any]:
    """Two Newton steps from rest, CPU s each: as much memory as a run needs, but for the states that it keeps."""
    held, values = loaded(displacement).on(mesh).prescribed(mesh)
    solver = "fastest" if variant == "default" else "mumps"
    options = (Options().tolerance, Options().volume_tolerance, Options().max_iterations)
    problem = SolidProblem(mesh, MATERIAL, KAPPA, held, values / increments, *options, solver)
    lin: Any = problem.linear
    if variant == "mumps-ooc":
        lin.ksp.getPC().getFactorMatrix().setMumpsIcntl(22, 1)
    if variant == "mumps-blr":
        factor = lin.ksp.getPC().getFactorMatrix()
        factor.setMumpsIcntl(35, 2)
        factor.setMumpsCntl(7, BLR_ACCURACY)
        lin.ksp.setType("cg")
        lin.ksp.setTolerances(rtol=1e-8, max_it=200)
    times = []
    for _ in range(2):
        start = time.process_time()
        if lin.step(problem.u, problem.q, np.where(problem.held, problem.values, 0.0), fresh=True) is None:
            raise RuntimeError("the linear solve failed")
        times.append(time.process_time() - start)
    return {"first_step_s": times[0], "next_step_s": times[1]}


def profile(mesh: SolidMesh, displacement: float, increments: int) -> dict[str, Any]:
    """The default with timers around its parts: [calls, CPU s] of each."""
    parts: dict[str, list[float]] = {}

    def timed(owner: Any, name: str, part: str) -> None:
        original = getattr(owner, name)
        entry = parts.setdefault(part, [0, 0.0])

        def wrapper(*arguments: Any) -> Any:
            start = time.process_time()
            try:
                return original(*arguments)
            finally:
                entry[0] += 1
                entry[1] += time.process_time() - start

        setattr(owner, name, wrapper)

    timed(pardiso, "block_pattern", "pattern")
    timed(pardiso, "block_places", "pattern")
    timed(pardiso, "scalar_pattern", "pattern")
    timed(pardiso._Factor, "__init__", "analyse")
    timed(pardiso._Factor, "update", "factorise")
    timed(pardiso._Factor, "solve", "triangular solves")
    for name, part in (("assemble", "assemble"), ("product", "products"), ("forces", "forces")):
        timed(Solid, name, part)
    timed(Solid, "pressure_step", "pressure steps")
    timed(SolidProblem, "energy", "stored energy")
    return {**run_ours(mesh, displacement, increments), "parts": parts}


def cross(size_factor: float, layers: int) -> SolidMesh:
    return extrude(quads(Cross(), quarter=True, size_factor=size_factor), THICKNESS, layers)


def peak() -> float:
    """Largest resident memory of this process so far, MB."""
    status = Path("/proc/self/status").read_text()
    return int(next(line for line in status.splitlines() if line.startswith("VmHWM")).split()[1]) / 1024


def main(case: dict[str, Any]) -> None:
    comm = MPI.COMM_WORLD
    limit = int(case["memory_gb"] * 1e9 / comm.size)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    METHODS.get(case["method"], run_ours)(cross(4.0, 1), 2.0, 1)  # compiles the forms, loads the libraries
    actions: dict[str, Action] = {**METHODS, "memory": memory, "profile": profile}
    options = {"variant": case["variant"]} if case["method"] == "memory" else {}
    mesh = cross(case["size_factor"], case["layers"])
    last = int(time.process_time() + case["timeout"]) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (last, last + 1))
    base, wall, cpu = peak(), time.perf_counter(), time.process_time()
    result = actions[case["method"]](mesh, case["displacement"], case["increments"], **options)
    result |= {"wall_s": time.perf_counter() - wall, "unknowns": mesh.points.size, "base_mb": base}
    result["cpu_s"] = comm.allreduce(time.process_time() - cpu)
    result["peak_mb"] = comm.allreduce(peak())
    result["largest_peak_mb"] = comm.allreduce(peak(), op=MPI.MAX)
    if comm.rank == 0:
        print(json.dumps({**case, **result}))


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
