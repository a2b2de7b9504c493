"""A run through the increments: a problem and its record in, the solution out; shown, saved and resumed.

What thin sheets, with and without a history, and the solid have in common. A checkpoint is a solution file with the
increments reached, and the state variables after the last of them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from tqdm import tqdm

from forward.errors import CheckpointError, ConvergenceError, LinearSolverError, SolutionError
from forward.loading import Motion
from forward.stepping import REST, History, Increment, Moment, Problem, State, Unknowns, steps
from meshes.errors import MeshError


class Solution(Protocol):
    """What a run yields and can go on from.

    time (n_inc,): s, or load factor where time plays no part; energy (n_inc,), N mm; iterations (n_inc,); reactions:
    side to (n_inc, d), the force of the grip on the specimen, N; description: of the problem; unknowns: fields
    (n_inc, ...); history: state variables after the last increment, by name; readings: side to (r, d), N, on the way to
    the increments; save: writes a file.
    """

    @property
    def time(self) -> np.ndarray: ...
    @property
    def energy(self) -> np.ndarray: ...
    @property
    def iterations(self) -> np.ndarray: ...
    @property
    def reactions(self) -> dict[str, np.ndarray]: ...
    @property
    def description(self) -> dict[str, Any]: ...
    @property
    def unknowns(self) -> Unknowns: ...
    @property
    def history(self) -> History: ...
    @property
    def readings(self) -> dict[str, np.ndarray]: ...
    def save(self, path: str | Path) -> None: ...


@dataclass(frozen=True)
class Control:
    """How a run is shown, saved and spread: a bar; a checkpoint file; the ranks of an MPI communicator."""

    progress: bool
    checkpoint: str | Path | None
    comm: Any


@dataclass
class Record:
    """Increments reached so far, and the problem they belong to.

    path: moments at which the increments end; problem: all that fixes the result but the mesh, as plain data;
    supports: which components are held, and how they move; rest: unknowns at rest; whole: what the forces of the
    modelled part are multiplied with, one number or one for each component; build: makes the solution of this record.
    between: moments on the way at which forces are read.
    """

    mesh: Any
    loading: Motion
    path: Sequence[Moment]
    problem: dict[str, Any]
    versions: dict[str, Any]
    rest: Unknowns
    build: Callable[[Record], Any]
    supports: tuple[np.ndarray, np.ndarray]
    whole: Any = 1.0
    between: Sequence[Moment] = ()
    states: list[State] = field(init=False)
    energies: list[float] = field(init=False, default_factory=list)
    forces: dict[str, list[np.ndarray]] = field(init=False)
    read: dict[str, list[np.ndarray]] = field(init=False)
    history: History = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        digest = hashlib.sha256(json.dumps(self.problem, sort_keys=True).encode())
        digest.update(np.ascontiguousarray(self.mesh.points).tobytes())
        for array in (self.mesh.cells, *self.supports):
            digest.update(np.ascontiguousarray(array).tobytes())
        self.description = {**self.problem, "digest": digest.hexdigest(), **self.versions}
        self.states = [State(REST, self.rest)]
        self.forces = {name: [] for name in self.loading.sides}
        self.read = {name: [] for name in self.loading.sides}

    @property
    def reached(self) -> int:
        """Increments."""
        return len(self.states) - 1

    @property
    def time(self) -> np.ndarray:
        """Of each increment reached, (n_inc,), s, or the load factor where time plays no part."""
        return np.array([s.moment.time for s in self.states[1:]])

    @property
    def load_factors(self) -> list[float]:
        """Of each increment reached, (n_inc,)."""
        return [s.moment.load_factor for s in self.states[1:]]

    @property
    def iterations(self) -> np.ndarray:
        """Of the solver in each increment reached, (n_inc,)."""
        return np.array([s.iterations for s in self.states[1:]], np.int64)

    @property
    def reactions(self) -> dict[str, np.ndarray]:
        """Side to the force of its grip on the specimen, (n_inc, d), N."""
        return {side: np.array(force).reshape(-1, self.mesh.points.shape[1]) for side, force in self.forces.items()}

    @property
    def readings(self) -> dict[str, np.ndarray]:
        """The same on the way to the increments reached, (r, d), N; empty where none were asked for."""
        if not self.between:
            return {}
        return {side: np.array(force).reshape(-1, self.mesh.points.shape[1]) for side, force in self.read.items()}

    @property
    def reading_times(self) -> np.ndarray:
        """Of the readings, (r,), s."""
        return np.array([moment.time for moment in self.between[: len(next(iter(self.read.values()), []))]])

    def unknowns(self, which: int) -> np.ndarray:
        """One field of the increments reached, (n_inc, ...)."""
        return np.array([s.unknowns[which] for s in self.states[1:]]).reshape(-1, *self.rest[which].shape)

    def add(self, increment: Increment) -> None:
        """Keep an equilibrium, with the forces of the grips."""
        for side, kept in self.forces.items():
            nodes = self.mesh.boundary_nodes(side)
            kept.append(self.whole * increment.forces[nodes].sum(axis=0))
            self.read[side] += [self.whole * one.forces[nodes].sum(axis=0) for one in increment.readings]
        self.energies.append(increment.energy)
        self.states.append(increment.state)
        self.history = increment.history

    def resume(self, solution: Solution, path: str | Path) -> None:
        """Go on from a checkpoint. Raises `SolutionError` if it is another problem's."""
        if solution.description.get("digest") != self.description["digest"]:
            raise SolutionError(
                f"{path}: this checkpoint belongs to another mesh, material, loading or option; "
                "remove it or name another file"
            )
        for i, moment in enumerate(self.path[: len(solution.time)]):
            fields = tuple(x[i] for x in solution.unknowns)
            self.states.append(State(moment, fields, int(solution.iterations[i])))
        self.energies = [float(e) for e in solution.energy]
        self.forces = {side: list(solution.reactions[side]) for side in self.forces}
        self.read = {side: list(solution.readings.get(side, [])) for side in self.read}
        self.history = solution.history


def run(
    record: Record,
    make_problem: Callable[[], Problem],
    load: Callable[[str | Path], Solution],
    label: str,
    max_bisections: int,
    control: Control,
    substeps: int = 1,
) -> Any:
    """The solution at the end of the record's path; from where the checkpoint ended, if that file is there.

    load: reads a checkpoint; label: of the bar. Raises `SolutionError`, `CheckpointError` (it cannot be written),
    `LinearSolverError` and `ConvergenceError`, whose `solution` holds the increments reached.
    """
    _resume(record, load, control)
    problem = make_problem()
    problem.history = record.history
    increments = steps(problem, record.path[record.reached :], record.states, max_bisections, substeps, record.between)
    try:
        _follow(record, increments, label, control)
    except LinearSolverError as error:
        raise LinearSolverError(f"{error}{_kept(record, control)}") from error
    except ConvergenceError as error:
        raise ConvergenceError(f"{error}{_kept(record, control)}", record.build(record)) from error
    return record.build(record)


def _resume(record: Record, load: Callable[[str | Path], Solution], control: Control) -> None:
    """Read the checkpoint, or write a first one, so that a place that cannot be written is told at once."""
    path, comm = control.checkpoint, control.comm
    if path is None:
        return
    if comm.bcast(Path(path).exists() if comm.rank == 0 else None):
        record.resume(load(path), path)
    else:
        _save(record, control)


def _follow(record: Record, increments: Iterator[Increment], label: str, control: Control) -> None:
    """Add the increments to the record, show and save them."""
    bar = tqdm(
        total=len(record.path),
        initial=record.reached,
        desc=label,
        unit="increment",
        disable=not control.progress or control.comm.rank > 0,
    )
    with bar:
        for increment in increments:
            record.add(increment)
            _save(record, control)
            bar.set_postfix(iterations=increment.state.iterations)
            bar.update()


def _kept(record: Record, control: Control) -> str:
    """Where the increments are that were reached before an error."""
    return f"; the {record.reached} increments before are in {control.checkpoint}" if control.checkpoint else ""


def _save(record: Record, control: Control) -> None:
    """Write the checkpoint, if there is to be one, on rank 0; every rank raises if that failed."""
    if control.checkpoint is None:
        return
    problem = None
    if control.comm.rank == 0:
        try:
            record.build(record).save(control.checkpoint)
        except MeshError as error:
            problem = str(error)
    problem = control.comm.bcast(problem)
    if problem is not None:
        kept = f"; the {record.reached - 1} increments saved before are unharmed" if record.reached > 1 else ""
        raise CheckpointError(f"{problem}{kept}")
