"""Sheets with a history: mesh, sheet, loading and its factors in time in; a `SurfaceSolution` in seconds out.

The physics of a step is in `inelastic_problem`; the load stepping is that of the elastic sheet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forward._dolfinx import MPI
from forward.errors import LoadingError
from forward.loading import Motion
from forward.run import Control
from forward.sheet.inelastic_problem import InelasticProblem
from forward.sheet.sheet_run import Options, Supports, check_sheet, run_sheet
from forward.sheet.thin_sheet import Sheet
from forward.solution import SurfaceSolution
from forward.stepping import Moment
from meshes import Mesh

Array = NDArray[np.float64]
Readings = Sequence[tuple[float, float]]


def solve_history(
    mesh: Mesh,
    sheet: Sheet,
    loading: Motion,
    factors: Sequence[float] | Array,
    times: Sequence[float] | Array,
    substeps: int = 1,
    options: Options = Options(),
    comm: Any = MPI.COMM_WORLD,
    progress: bool = False,
    checkpoint: str | Path | None = None,
    readings: Readings = (),
) -> SurfaceSolution:
    """Load by `factors` (t,) of `loading` at `times` (t,), s, from rest at time 0; straight lines between.

    substeps: steps of an increment, at least. readings: times, s, and factors on the way at which the load cell is read, straight lines to and from
    them; the forces are kept, the displacements are not. `checkpoint` is a solution file, rewritten after each increment; if it is
    there already, the run goes on from its last increment. Raises `LoadingError`, `MaterialError` (a model in N/mm with
    another thickness than 1), `MissingSolverError` (no C compiler), `SolutionError` (checkpoint of another problem),
    `CheckpointError` and `ConvergenceError`, whose `solution` holds the increments reached.
    """
    check_sheet(mesh, sheet.material, sheet.thickness)
    path, between = _path(factors, times, substeps), _between(readings, times)
    described = {
        **sheet.to_dict(),
        "substeps": substeps,
        "options": asdict(options),
        "load_factors": [moment.load_factor for moment in path],
        "times": [moment.time for moment in path],
        **({"readings": [[moment.time, moment.load_factor] for moment in between]} if between else {}),
    }

    def make_problem(mesh: Mesh, supports: Supports) -> InelasticProblem:
        return InelasticProblem(mesh, sheet, *supports, options.tolerance, options.max_iterations, comm)

    control = Control(progress, checkpoint, comm)
    return run_sheet(
        mesh,
        loading,
        path,
        described,
        make_problem,
        "sheet with a history",
        options.max_bisections,
        control,
        substeps,
        between,
    )


def _between(readings: Readings, times: Sequence[float] | Array) -> list[Moment]:
    """Raises `LoadingError` for readings that do not rise, or are not on the way."""
    when = np.array([time for time, _ in readings])
    if len(when) and not ((np.diff(when, prepend=0.0) > 0).all() and when[-1] < times[-1]):
        raise LoadingError(f"readings must rise from above 0 s to before the last increment at {times[-1]:g} s")
    if np.isin(when, times).any():
        raise LoadingError("a reading is at the time of an increment, whose forces are kept anyway; leave it out")
    return [Moment(float(time), float(factor)) for time, factor in readings]


def _path(factors: Sequence[float] | Array, times: Sequence[float] | Array, substeps: int) -> list[Moment]:
    if len(factors) != len(times) or not len(times) or substeps < 1:
        raise LoadingError(f"{len(factors)} load factors at {len(times)} times in {substeps} substeps; give one each")
    if not (np.isfinite(factors).all() and np.isfinite(times).all() and (np.diff(times, prepend=0.0) > 0).all()):
        raise LoadingError("load factors and times must be finite, and times rise from above 0 s")
    return [Moment(float(t), float(f)) for f, t in zip(factors, times, strict=True)]
