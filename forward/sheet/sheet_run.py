"""What the runs of a thin sheet share, with and without a history: options, checks, record and solution."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from forward._dolfinx import versions
from forward.errors import LoadingError, MaterialError
from forward.loading import Motion
from forward.materials import Material
from forward.run import Control, Record, run
from forward.solution import SurfaceSolution
from forward.stepping import Moment, Problem
from meshes import Mesh

Supports = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Options:
    """tolerance: imbalance of free nodes over norm of nodal reactions; Newton iterations and halvings allowed."""

    tolerance: float = 1e-10
    max_iterations: int = 25
    max_bisections: int = 6


def check_sheet(mesh: Mesh, material: Material, thickness: float) -> None:
    """Raises `LoadingError` for a mesh of straight triangles, `MaterialError` for a model in N/mm with another thickness than 1."""
    if not mesh.element.edges_have_middles:
        raise LoadingError("the forward model needs quads; make the mesh with meshes.quads")
    if material.unit == "N/mm" and thickness != 1:
        raise MaterialError("the model was calibrated without a thickness and includes it; solve with thickness 1")


def run_sheet(
    mesh: Mesh,
    loading: Motion,
    path: Sequence[Moment],
    described: dict[str, Any],
    make_problem: Callable[[Mesh, Supports], Problem],
    label: str,
    max_bisections: int,
    control: Control,
    substeps: int = 1,
    between: Sequence[Moment] = (),
) -> SurfaceSolution:
    """Follow the path of load factors of `loading`. described: all else that fixes the result, with its `thickness`; between: moments on the
    way at which forces are read."""
    mesh = control.comm.bcast(mesh)
    loading = loading.on(mesh)
    supports = loading.prescribed(mesh)
    record = Record(
        mesh,
        loading,
        path,
        problem={**described, "loading": loading.to_dict()},
        versions=versions(),
        rest=(np.zeros_like(mesh.points),),
        build=_solution,
        supports=supports,
        between=between,
    )

    def make() -> Problem:
        return make_problem(mesh, supports)

    return run(record, make, SurfaceSolution.load, label, max_bisections, control, substeps)


def _solution(record: Record) -> SurfaceSolution:
    description = record.description
    if "load_factors" in description:
        description = {**description, "load_factors": record.load_factors}
    return SurfaceSolution(
        mesh=record.mesh,
        displacements=record.unknowns(0),
        reactions=record.reactions,
        time=record.time,
        energy=np.array(record.energies),
        iterations=record.iterations,
        thickness=record.problem["thickness"],
        description=description,
        history=record.history,
        readings=record.readings,
        reading_times=record.reading_times,
    )
