"""Sheets with a history: mesh, sheet, loading and its factors in time in; a `SurfaceSolution` in seconds out.

The physics of a step is in `inelastic_problem`; here the steps follow a path of load factors, which may turn.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forward._dolfinx import MPI, compiler_needed, versions
from forward.errors import ConvergenceError, LoadingError, MaterialError
from forward.loading import SYMMETRY, Loading
from forward.sheet.additions import Sheet
from forward.sheet.inelastic_problem import InelasticProblem
from forward.sheet.plane_stress import Options
from forward.solution import SurfaceSolution
from forward.stepping import HISTORY, State, predict
from meshes import Mesh

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Moment:
    """A time, s, and the load factor then."""

    time: float
    factor: float


def solve_history(
    mesh: Mesh,
    sheet: Sheet,
    loading: Loading,
    factors: Sequence[float] | Array,
    times: Sequence[float] | Array,
    substeps: int = 1,
    options: Options = Options(),
    comm: Any = MPI.COMM_WORLD,
) -> SurfaceSolution:
    """Load by `factors` (t,) of `loading` at `times` (t,), s, from rest at time 0; straight lines between.

    substeps: steps of an increment, at least. Raises `LoadingError`, `MaterialError` (a model in N/mm with another thickness
    than 1), `MissingSolverError` (no C compiler) and `ConvergenceError`, whose `solution` holds the increments reached.
    """
    if mesh.cell_type != "quad":
        raise LoadingError("the forward model needs quads; make the mesh with meshes.quads")
    if sheet.material.unit == "N/mm" and sheet.thickness != 1:
        raise MaterialError("the model was calibrated without a thickness and includes it; solve with thickness 1")
    moments = _moments(factors, times, substeps)
    loading = loading.on(mesh)
    supports = loading.prescribed(mesh)
    with compiler_needed():
        problem = InelasticProblem(mesh, sheet, *supports, options.tolerance, options.max_iterations, comm)
    kept = _Kept(problem, sheet, {n: mesh.boundary_nodes(n) for n in loading.displacements if n not in SYMMETRY})
    kept.description = {**sheet.to_dict(), "loading": loading.to_dict(), "substeps": substeps, **versions()}
    try:
        for moment, iterations in _march(problem, moments, substeps, options.max_bisections):
            kept.add(moment, iterations)
    except ConvergenceError as error:
        raise ConvergenceError(str(error), kept.solution()) from error
    return kept.solution()


class _Kept:
    """The increments reached."""

    def __init__(self, problem: InelasticProblem, sheet: Sheet, sides: dict[str, NDArray[np.int64]]) -> None:
        self.problem, self.sheet, self.sides = problem, sheet, sides
        self.description: dict[str, Any] = {}
        self.moments: list[_Moment] = []
        self.displacements: list[Array] = []
        self.forces: dict[str, list[Array]] = {side: [] for side in sides}
        self.energies: list[float] = []
        self.iterations: list[int] = []

    def add(self, moment: _Moment, iterations: int) -> None:
        forces = self.problem.nodal_forces()
        for side, nodes in self.sides.items():
            self.forces[side].append(forces[nodes].sum(axis=0))
        self.displacements.append(self.problem.displacements)
        self.energies.append(self.problem.energy())
        self.moments.append(moment)
        self.iterations.append(iterations)

    def solution(self) -> SurfaceSolution:
        mesh = self.problem.mesh
        return SurfaceSolution(
            mesh,
            np.array(self.displacements).reshape(-1, *mesh.points.shape),
            {side: np.array(force).reshape(-1, 2) for side, force in self.forces.items()},
            np.array([m.time for m in self.moments]),
            np.array(self.energies),
            np.array(self.iterations, np.int64),
            self.sheet.thickness,
            {**self.description, "load_factors": [m.factor for m in self.moments]},
        )


def _moments(factors: Sequence[float] | Array, times: Sequence[float] | Array, substeps: int) -> list[_Moment]:
    if len(factors) != len(times) or not len(times) or substeps < 1:
        raise LoadingError(f"{len(factors)} load factors at {len(times)} times in {substeps} substeps; give one each")
    if not (np.isfinite(factors).all() and np.isfinite(times).all() and (np.diff(times, prepend=0.0) > 0).all()):
        raise LoadingError("load factors and times must be finite, and times rise from above 0 s")
    return [_Moment(float(t), float(f)) for f, t in zip(factors, times, strict=True)]


def _march(
    problem: InelasticProblem, moments: Sequence[_Moment], substeps: int, max_bisections: int
) -> Iterator[tuple[_Moment, int]]:
    """Solve from moment to moment, each step halved where Newton's method fails."""
    known = [State(0.0, problem.unknowns)]
    last = _Moment(0.0, 0.0)
    for target in moments:
        part, smallest = 1.0 / substeps, 0.5**max_bisections / substeps
        done, iterations = 0.0, 0
        while done < 1.0:
            share = 1.0 if done + part > 1 - 1e-12 else done + part
            factor = last.factor + share * (target.factor - last.factor)
            problem.unknowns = predict(known, factor)
            outcome = problem.step(factor, (share - done) * (target.time - last.time))
            iterations += outcome.iterations
            if outcome.converged:
                known = _distinct([*known, State(factor, problem.unknowns)])
                done = share
                if done == 1.0:
                    yield target, iterations  # before the state is committed, which changes the forces
                problem.commit()
                continue
            problem.unknowns = known[-1].unknowns
            part /= 2
            if part < smallest * (1 - 1e-9):
                raise ConvergenceError(
                    f"no equilibrium after {last.time + done * (target.time - last.time):.4g} s: {outcome.text}. Load "
                    "less, use more increments, refine the mesh or check the material"
                )
        last = target


def _distinct(states: list[State]) -> list[State]:
    """The last states, three at most, at different load factors, through which a polynomial can be laid."""
    kept: list[State] = []
    for state in reversed(states):
        if len(kept) < HISTORY and all(abs(state.load_factor - k.load_factor) > 1e-6 for k in kept):
            kept.insert(0, state)
    return kept
