"""Forward model of a thick, nearly incompressible specimen: mesh, material and loading in, `SolidSolution` out.

Runs the same under `mpiexec -n`. The physics is in `solid_problem`, the load stepping in `forward.stepping`.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from forward._dolfinx import MPI, versions
from forward.errors import LoadingError, MaterialError
from forward.loading import Loading
from forward.materials import Material
from forward.run import Control, Record, run
from forward.solid.element import PRESSURES
from forward.solid.solid_problem import SolidProblem
from forward.solid.solid_solution import SolidSolution
from forward.stepping import proportional
from meshes.extrusion import SolidMesh

DEFAULT_INCREMENTS = 10
BULK_TO_SHEAR = 1e4
LAYERS = ((15.0, 2), (20.0, 3), (30.0, 4), (math.inf, 5))  # of half the thickness, up to a thickness in mm


@dataclass(frozen=True)
class Options:
    """tolerance: imbalance of free nodes over norm of nodal reactions; volume_tolerance: rms of J - 1 - p / kappa;
    Newton iterations and halvings allowed; solver: 'pardiso', 'mumps', or 'fastest': PARDISO where it is installed
    and there is one rank. Raises `LoadingError` for tolerances that are not positive."""

    tolerance: float = 1e-8
    volume_tolerance: float = 1e-9
    max_iterations: int = 15
    max_bisections: int = 6
    solver: str = "fastest"

    def __post_init__(self) -> None:
        if not (self.tolerance > 0 and self.volume_tolerance > 0):
            raise LoadingError("tolerances must be positive")


def default_layers(thickness: float) -> int:
    """Layers of hexes in half the thickness, mm, that the thickness study found to be enough."""
    return next(layers for limit, layers in LAYERS if thickness <= limit)


def solve(
    mesh: SolidMesh,
    material: Material,
    loading: Loading,
    n_increments: int = DEFAULT_INCREMENTS,
    bulk_modulus: float | None = None,
    options: Options = Options(),
    progress: bool = False,
    checkpoint: str | Path | None = None,
    comm: Any = MPI.COMM_WORLD,
) -> SolidSolution:
    """Load in `n_increments` equal steps. bulk_modulus: MPa, 1e4 times the initial shear modulus by default.

    `checkpoint` is a solution file, rewritten after each increment; if it is there already, the run goes on from its
    last increment. Raises `LoadingError`, `MaterialError`, `SolutionError` (checkpoint of another problem),
    `CheckpointError`, `LinearSolverError`, `MissingSolverError` (no C compiler) and `ConvergenceError`, whose
    `solution` holds the increments reached.
    """
    kappa = BULK_TO_SHEAR * material.shear_modulus if bulk_modulus is None else bulk_modulus
    _check(mesh, material, n_increments, kappa)
    mesh = comm.bcast(mesh)
    described = {
        "material": material.to_dict(),
        "n_increments": n_increments,
        "thickness": mesh.thickness,
        "bulk_modulus": kappa,
        "options": asdict(options),
    }
    record = _record(mesh, loading.on(mesh), n_increments, described)

    def make_problem() -> SolidProblem:
        given = mesh, material, kappa, *record.supports
        accuracy = options.tolerance, options.volume_tolerance
        return SolidProblem(*given, *accuracy, options.max_iterations, options.solver, comm)

    label, control = f"solid {mesh.thickness:g} mm", Control(progress, checkpoint, comm)
    return run(record, make_problem, SolidSolution.load, label, options.max_bisections, control)


def _check(mesh: SolidMesh, material: Material, n_increments: int, bulk_modulus: float) -> None:
    """Raises `LoadingError`, `MaterialError`."""
    if not isinstance(mesh, SolidMesh):
        raise LoadingError("the solid needs hexes; make the mesh with meshes.extrude")
    if n_increments < 1 or n_increments != int(n_increments):
        raise LoadingError(f"{n_increments} increments: give a whole number, at least one")
    if material.unit == "N/mm":
        raise MaterialError("the model was calibrated without a thickness; a solid needs one in MPa")
    if not (math.isfinite(bulk_modulus) and bulk_modulus > 0):
        raise MaterialError(f"bulk modulus {bulk_modulus} MPa: give a positive number")


def _record(mesh: SolidMesh, loading: Loading, n_increments: int, described: dict[str, Any]) -> Record:
    """At rest; described: all that fixes the result but mesh and loading."""
    return Record(
        mesh,
        loading,
        proportional(n_increments),
        problem={**described, "loading": loading.to_dict()},
        versions=versions(),
        rest=(np.zeros_like(mesh.points), np.zeros((len(mesh.cells), PRESSURES))),
        build=_solution,
        supports=loading.prescribed(mesh),
        # the half below the mid-plane is pulled alike in the plane and the other way across it
        whole=np.array([2.0, 2.0, 0.0]) if mesh.symmetric else 1.0,
    )


def _solution(record: Record) -> SolidSolution:
    return SolidSolution(
        mesh=record.mesh,
        displacements=record.unknowns(0),
        pressure=record.unknowns(1),
        reactions=record.reactions,
        time=record.time,
        energy=np.array(record.energies),
        iterations=record.iterations,
        bulk_modulus=record.problem["bulk_modulus"],
        description=record.description,
    )
