"""Forward model of a thin incompressible sheet: mesh, material and loading in, `SurfaceSolution` out.

Runs the same under `mpiexec -n`. The physics is in `problem`, the load stepping in `stepping`.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from forward._dolfinx import MPI, PETSC_VERSION, QUADRATURE_DEGREE, compiler_needed, dolfinx
from forward.errors import ConvergenceError, LoadingError, MaterialError, SolutionError
from forward.loading import SYMMETRY, Loading
from forward.materials import ArrudaBoyce, Material
from forward.problem import PlaneStressProblem
from forward.solution import SurfaceSolution
from forward.stepping import State, steps
from meshes import Cross, Mesh, quads

DEFAULT_DISPLACEMENT = 60.0
DEFAULT_INCREMENTS = 10


@dataclass(frozen=True)
class Options:
    """tolerance: imbalance of free nodes over norm of nodal reactions; Newton iterations and halvings allowed."""

    tolerance: float = 1e-10
    max_iterations: int = 25
    max_bisections: int = 6


def solve(
    mesh: Mesh,
    material: Material,
    loading: Loading,
    n_increments: int = DEFAULT_INCREMENTS,
    thickness: float = 1.0,
    options: Options = Options(),
    progress: bool = False,
    checkpoint: str | Path | None = None,
    comm: Any = MPI.COMM_WORLD,
) -> SurfaceSolution:
    """Load in `n_increments` equal steps. thickness: mm.

    `checkpoint` is a solution file, rewritten after each increment; if it is there already, the run goes on
    from its last increment. Raises `LoadingError`, `SolutionError` (checkpoint of another problem) and
    `ConvergenceError`, whose `solution` holds the increments reached.
    """
    if mesh.cell_type != "quad":
        raise LoadingError("the forward model needs quads; make the mesh with meshes.quads")
    if n_increments < 1 or not (math.isfinite(thickness) and thickness > 0):
        raise LoadingError(f"{n_increments} increments, thickness {thickness} mm: both must be positive")
    if material.unit == "N/mm" and thickness != 1:
        raise MaterialError("the model was calibrated without a thickness and includes it; solve with thickness 1")
    mesh = comm.bcast(mesh)
    loading = loading.on(mesh)
    record = _Record(mesh, material, loading, n_increments, thickness, options)
    if checkpoint is not None and comm.bcast(Path(checkpoint).exists() if comm.rank == 0 else None):
        record.resume(SurfaceSolution.load(checkpoint), checkpoint)
    supports = loading.prescribed(mesh)
    with compiler_needed():
        problem = PlaneStressProblem(
            mesh, material, thickness, *supports, options.tolerance, options.max_iterations, comm
        )
    factors = np.arange(1, n_increments + 1) / n_increments
    to_do = [float(t) for t in factors[len(record.states) - 1 :]]
    bar = tqdm(
        total=n_increments,
        initial=n_increments - len(to_do),
        desc="plane stress",
        unit="increment",
        disable=not progress or comm.rank > 0,
    )
    with bar:
        try:
            for state in steps(problem, to_do, record.states, options.max_bisections):
                record.add(state, problem)
                if checkpoint is not None and comm.rank == 0:
                    record.solution().save(checkpoint)
                bar.set_postfix(iterations=state.iterations)
                bar.update()
        except ConvergenceError as error:
            where = f"; the {len(record.states) - 1} increments before are in {checkpoint}" if checkpoint else ""
            raise ConvergenceError(f"{error}{where}", record.solution()) from error
    return record.solution()


def default_experiment(
    displacement: float = DEFAULT_DISPLACEMENT, size_factor: float = 1.0, **keywords: Any
) -> SurfaceSolution:
    """The cross, pulled at its four arms, in Arruda-Boyce rubber, 1 mm thick: a quarter is solved and mirrored."""
    specimen = Cross()
    loading = Loading.clamped(specimen.loaded, displacement)
    material = keywords.pop("material", ArrudaBoyce())
    return solve(quads(specimen, quarter=True, size_factor=size_factor), material, loading, **keywords).mirrored()


class _Record:
    """Increments reached so far, and the problem they belong to."""

    def __init__(
        self,
        mesh: Mesh,
        material: Material,
        loading: Loading,
        n_increments: int,
        thickness: float,
        options: Options,
    ) -> None:
        self.mesh, self.loading, self.thickness = mesh, loading, thickness
        problem = {
            "material": material.to_dict(),
            "loading": loading.to_dict(),
            "n_increments": n_increments,
            "thickness": thickness,
            "options": asdict(options),
        }
        digest = hashlib.sha256(json.dumps(problem, sort_keys=True).encode())
        digest.update(mesh.points.tobytes() + mesh.cells.tobytes())
        self.description = {
            **problem,
            "digest": digest.hexdigest(),
            "dolfinx": dolfinx.__version__,
            "petsc": PETSC_VERSION,
            "quadrature_degree": QUADRATURE_DEGREE,
        }
        self.states = [State(0.0, np.zeros_like(mesh.points))]
        self.energies: list[float] = []
        self.sides = [name for name in loading.displacements if name not in SYMMETRY]
        self.forces: dict[str, list[np.ndarray]] = {name: [] for name in self.sides}

    def add(self, state: State, problem: PlaneStressProblem) -> None:
        forces = problem.nodal_forces()
        for side in self.sides:
            self.forces[side].append(forces[self.mesh.boundary_nodes(side)].sum(axis=0))
        self.energies.append(problem.energy())
        self.states.append(state)

    def resume(self, solution: SurfaceSolution, path: str | Path) -> None:
        if solution.description.get("digest") != self.description["digest"]:
            raise SolutionError(
                f"{path}: this checkpoint belongs to another mesh, material, loading or option; "
                "remove it or name another file"
            )
        fields = zip(solution.time, solution.displacements, solution.iterations, strict=True)
        self.states += [State(float(t), u, int(n)) for t, u, n in fields]
        self.energies = [float(e) for e in solution.energy]
        self.forces = {side: list(solution.reactions[side]) for side in self.sides}

    def solution(self) -> SurfaceSolution:
        reached = self.states[1:]
        return SurfaceSolution(
            mesh=self.mesh,
            displacements=np.array([s.displacements for s in reached]).reshape(-1, *self.mesh.points.shape),
            reactions={side: np.array(force).reshape(-1, 2) for side, force in self.forces.items()},
            time=np.array([s.load_factor for s in reached]),
            energy=np.array(self.energies),
            iterations=np.array([s.iterations for s in reached], np.int64),
            thickness=self.thickness,
            description=self.description,
        )
