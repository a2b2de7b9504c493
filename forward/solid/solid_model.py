"""Forward model of a thick, nearly incompressible specimen: mesh, material and loading in, `SolidSolution` out.

Runs the same under `mpiexec -n`. The physics is in `solid_problem`, the load stepping in `stepping`.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from forward._dolfinx import MPI, compiler_needed, versions
from forward.errors import LoadingError, MaterialError
from forward.loading import Loading
from forward.materials import Material
from forward.run import Record, run
from forward.solid.element import PRESSURES
from forward.solid.solid_problem import SolidProblem
from forward.solid.solid_solution import SolidSolution
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
    if not isinstance(mesh, SolidMesh):
        raise LoadingError("the solid needs hexes; make the mesh with meshes.extrude")
    if n_increments < 1 or n_increments != int(n_increments):
        raise LoadingError(f"{n_increments} increments: give a whole number, at least one")
    if material.unit == "N/mm":
        raise MaterialError("the model was calibrated without a thickness; a solid needs one in MPa")
    kappa = BULK_TO_SHEAR * material.shear_modulus if bulk_modulus is None else bulk_modulus
    if not (math.isfinite(kappa) and kappa > 0):
        raise MaterialError(f"bulk modulus {kappa} MPa: give a positive number")
    mesh = comm.bcast(mesh)
    loading = loading.on(mesh)
    supports = loading.prescribed(mesh)
    record = Record(
        mesh,
        loading,
        problem={
            "material": material.to_dict(),
            "loading": loading.to_dict(),
            "n_increments": n_increments,
            "thickness": mesh.thickness,
            "bulk_modulus": kappa,
            "options": asdict(options),
        },
        versions=versions(),
        rest=(np.zeros_like(mesh.points), np.zeros((len(mesh.cells), PRESSURES))),
        build=_solution,
        supports=supports,
        # the half below the mid-plane is pulled alike in the plane and the other way across it
        whole=np.array([2.0, 2.0, 0.0]) if mesh.symmetric else 1.0,
    )

    def make_problem() -> SolidProblem:
        with compiler_needed():
            return SolidProblem(
                mesh,
                material,
                kappa,
                *supports,
                options.tolerance,
                options.volume_tolerance,
                options.max_iterations,
                options.solver,
                comm,
            )

    return run(
        record,
        make_problem,
        SolidSolution.load,
        n_increments,
        options.max_bisections,
        f"solid {mesh.thickness:g} mm",
        progress,
        checkpoint,
        comm,
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
