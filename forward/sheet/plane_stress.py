"""Forward model in the plane: mesh, material and loading in, `SurfaceSolution` out.

A thin incompressible sheet in plane stress or, where a bulk modulus is given, a compressible body in plane strain.

Runs the same under `mpiexec -n`. The physics is in `problem`, the load stepping in `stepping`.
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
from forward.materials import ArrudaBoyce, Material
from forward.run import Record, run
from forward.sheet.plane_strain import PlaneStrainProblem, check_bulk_modulus
from forward.sheet.plane_stress_problem import PlaneStressProblem
from forward.solution import SurfaceSolution
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
    bulk_modulus: float | None = None,
) -> SurfaceSolution:
    """Load in `n_increments` equal steps. thickness: mm. bulk_modulus: MPa, in plane strain; None: in plane stress.

    `checkpoint` is a solution file, rewritten after each increment; if it is there already, the run goes on from its
    last increment. Raises `LoadingError`, `MaterialError` (a model in N/mm with another thickness than 1, a bulk
    modulus that cannot be), `MissingSolverError` (no C compiler), `SolutionError` (checkpoint of another problem),
    `CheckpointError` and `ConvergenceError`, whose `solution` holds the increments reached.
    """
    if mesh.cell_type != "quad":
        raise LoadingError("the forward model needs quads; make the mesh with meshes.quads")
    if n_increments < 1 or n_increments != int(n_increments) or not (math.isfinite(thickness) and thickness > 0):
        raise LoadingError(
            f"{n_increments} increments, thickness {thickness} mm: both must be positive, increments whole"
        )
    if material.unit == "N/mm" and thickness != 1:
        raise MaterialError("the model was calibrated without a thickness and includes it; solve with thickness 1")
    if bulk_modulus is not None:
        check_bulk_modulus(bulk_modulus, material.shear_modulus)
    plane = {} if bulk_modulus is None else {"plane": "strain", "bulk_modulus": bulk_modulus}
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
            "thickness": thickness,
            "options": asdict(options),
            **plane,
        },
        versions=versions(),
        rest=(np.zeros_like(mesh.points),),
        build=_solution,
        supports=supports,
    )

    def make_problem() -> PlaneStressProblem:
        with compiler_needed():
            given = mesh, material, thickness, *supports, options.tolerance, options.max_iterations, comm
            if bulk_modulus is None:
                return PlaneStressProblem(*given)
            return PlaneStrainProblem(*given, bulk_modulus=bulk_modulus)

    return run(
        record,
        make_problem,
        SurfaceSolution.load,
        n_increments,
        options.max_bisections,
        "plane strain" if plane else "plane stress",
        progress,
        checkpoint,
        comm,
    )


def default_experiment(
    displacement: float = DEFAULT_DISPLACEMENT, size_factor: float = 1.0, **keywords: Any
) -> SurfaceSolution:
    """The cross, pulled at its four arms, in Arruda-Boyce rubber, 1 mm thick: a quarter is solved and mirrored.

    displacement: of each arm, mm. size_factor: of the mesh sizes. keywords: of `solve`, whose errors it raises.
    """
    specimen = Cross()
    loading = Loading.clamped(specimen.loaded, displacement)
    material = keywords.pop("material", ArrudaBoyce())
    return solve(quads(specimen, quarter=True, size_factor=size_factor), material, loading, **keywords).mirrored()


def _solution(record: Record) -> SurfaceSolution:
    return SurfaceSolution(
        mesh=record.mesh,
        displacements=record.unknowns(0),
        reactions=record.reactions,
        time=record.time,
        energy=np.array(record.energies),
        iterations=record.iterations,
        thickness=record.problem["thickness"],
        description=record.description,
    )
