"""Forward model in the plane: mesh, material and loading in, `SurfaceSolution` out.

A thin incompressible sheet in plane stress or, where a bulk modulus is given, a compressible body in plane strain.

Runs the same under `mpiexec -n`. The physics is in `plane_stress_problem`, the load stepping in `forward.stepping`.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

from forward._dolfinx import MPI
from forward.errors import LoadingError
from forward.loading import Loading, Motion
from forward.materials import ArrudaBoyce, Material
from forward.run import Control
from forward.sheet.plane_strain import PlaneStrainProblem, check_bulk_modulus
from forward.sheet.plane_stress_problem import PlaneStressProblem
from forward.sheet.sheet_run import Options, Supports, check_sheet, run_sheet
from forward.solution import SurfaceSolution
from forward.stepping import proportional
from meshes import Cross, Mesh, quads

DEFAULT_DISPLACEMENT = 60.0
DEFAULT_INCREMENTS = 10


def solve(
    mesh: Mesh,
    material: Material,
    loading: Motion,
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
    check_sheet(mesh, material, thickness)
    if n_increments < 1 or n_increments != int(n_increments) or not (math.isfinite(thickness) and thickness > 0):
        raise LoadingError(
            f"{n_increments} increments, thickness {thickness} mm: both must be positive, increments whole"
        )
    if bulk_modulus is not None:
        check_bulk_modulus(bulk_modulus, material.shear_modulus)
    described = {
        "material": material.to_dict(),
        "n_increments": n_increments,
        "thickness": thickness,
        "options": asdict(options),
        **({} if bulk_modulus is None else {"plane": "strain", "bulk_modulus": bulk_modulus}),
    }

    def make_problem(mesh: Mesh, supports: Supports) -> PlaneStressProblem:
        given = mesh, material, thickness, *supports, options.tolerance, options.max_iterations, comm
        if bulk_modulus is None:
            return PlaneStressProblem(*given)
        return PlaneStrainProblem(*given, bulk_modulus=bulk_modulus)

    label = "plane stress" if bulk_modulus is None else "plane strain"
    control = Control(progress, checkpoint, comm)
    path = proportional(n_increments)
    return run_sheet(mesh, loading, path, described, make_problem, label, options.max_bisections, control)


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
