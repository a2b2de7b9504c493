"""A run through the increments: a problem and its record in, the solution out; shown, saved and resumed.

What plane stress and the solid have in common. A checkpoint is a solution file with the increments reached.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from tqdm import tqdm

from forward.errors import CheckpointError, ConvergenceError, LinearSolverError, SolutionError
from forward.loading import SYMMETRY, Loading
from forward.stepping import Problem, State, Unknowns, steps
from meshes.errors import MeshError


class Reporting(Problem, Protocol):
    """A problem that tells its nodal forces (n, d), N, and stored energy, N mm."""

    def nodal_forces(self) -> np.ndarray: ...
    def energy(self) -> float: ...


class Solution(Protocol):
    """What a run yields and can go on from.

    time (n_inc,): load factor; energy (n_inc,), N mm; iterations (n_inc,); reactions: side to (n_inc, d), the force of
    the grip on the specimen, N; description: of the problem; unknowns: fields (n_inc, ...); save: writes a file.
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
    def save(self, path: str | Path) -> None: ...


@dataclass
class Record:
    """Increments reached so far, and the problem they belong to.

    problem: all that fixes the result but the mesh, as plain data; supports: which components are held, and where they
    end; rest: unknowns at rest; whole: what the forces
    of the modelled part are multiplied with, one number or one for each component; build: makes the solution of this
    record.
    """

    mesh: Any
    loading: Loading
    problem: dict[str, Any]
    versions: dict[str, Any]
    rest: Unknowns
    build: Callable[[Record], Any]
    supports: tuple[np.ndarray, np.ndarray]
    whole: Any = 1.0
    states: list[State] = field(init=False)
    energies: list[float] = field(init=False, default_factory=list)
    forces: dict[str, list[np.ndarray]] = field(init=False)

    def __post_init__(self) -> None:
        digest = hashlib.sha256(json.dumps(self.problem, sort_keys=True).encode())
        digest.update(np.ascontiguousarray(self.mesh.points).tobytes())
        for array in (self.mesh.cells, *self.supports):
            digest.update(np.ascontiguousarray(array).tobytes())
        self.description = {**self.problem, "digest": digest.hexdigest(), **self.versions}
        self.states = [State(0.0, self.rest)]
        self.forces = {name: [] for name in self.loading.displacements if name not in SYMMETRY}

    @property
    def reached(self) -> int:
        """Increments."""
        return len(self.states) - 1

    @property
    def time(self) -> np.ndarray:
        """Load factor of each increment reached, (n_inc,)."""
        return np.array([s.load_factor for s in self.states[1:]])

    @property
    def iterations(self) -> np.ndarray:
        """Of the solver in each increment reached, (n_inc,)."""
        return np.array([s.iterations for s in self.states[1:]], np.int64)

    @property
    def reactions(self) -> dict[str, np.ndarray]:
        """Side to the force of its grip on the specimen, (n_inc, d), N."""
        return {side: np.array(force).reshape(-1, self.mesh.points.shape[1]) for side, force in self.forces.items()}

    def unknowns(self, which: int) -> np.ndarray:
        """One field of the increments reached, (n_inc, ...)."""
        return np.array([s.unknowns[which] for s in self.states[1:]]).reshape(-1, *self.rest[which].shape)

    def add(self, state: State, problem: Reporting) -> None:
        """Keep an equilibrium, with the forces of the grips."""
        forces = problem.nodal_forces()
        for side, kept in self.forces.items():
            kept.append(self.whole * forces[self.mesh.boundary_nodes(side)].sum(axis=0))
        self.energies.append(problem.energy())
        self.states.append(state)

    def resume(self, solution: Solution, path: str | Path) -> None:
        """Go on from a checkpoint. Raises `SolutionError` if it is another problem's."""
        if solution.description.get("digest") != self.description["digest"]:
            raise SolutionError(
                f"{path}: this checkpoint belongs to another mesh, material, loading or option; "
                "remove it or name another file"
            )
        for i, t in enumerate(solution.time):
            fields = tuple(x[i] for x in solution.unknowns)
            self.states.append(State(float(t), fields, int(solution.iterations[i])))
        self.energies = [float(e) for e in solution.energy]
        self.forces = {side: list(solution.reactions[side]) for side in self.forces}


def run(
    record: Record,
    make_problem: Callable[[], Reporting],
    load: Callable[[str | Path], Solution],
    n_increments: int,
    max_bisections: int,
    label: str,
    progress: bool,
    checkpoint: str | Path | None,
    comm: Any,
) -> Any:
    """The solution after `n_increments` equal steps; from where `checkpoint` ended, if that file is there.

    Raises `SolutionError`, `CheckpointError` (it cannot be written), `LinearSolverError` and `ConvergenceError`, whose
    `solution` holds the increments reached.
    """
    if checkpoint is not None:
        if comm.bcast(Path(checkpoint).exists() if comm.rank == 0 else None):
            record.resume(load(checkpoint), checkpoint)
        else:
            _save(record, checkpoint, comm)
    problem = make_problem()
    factors = np.arange(1, n_increments + 1) / n_increments
    to_do = [float(t) for t in factors[record.reached :]]
    bar = tqdm(
        total=n_increments,
        initial=record.reached,
        desc=label,
        unit="increment",
        disable=not progress or comm.rank > 0,
    )
    with bar:
        try:
            for state in steps(problem, to_do, record.states, max_bisections):
                record.add(state, problem)
                if checkpoint is not None:
                    _save(record, checkpoint, comm)
                bar.set_postfix(iterations=state.iterations)
                bar.update()
        except LinearSolverError as error:
            kept = f"; the {record.reached} increments before are in {checkpoint}" if checkpoint else ""
            raise LinearSolverError(f"{error}{kept}") from error
        except ConvergenceError as error:
            where = f"; the {record.reached} increments before are in {checkpoint}" if checkpoint else ""
            raise ConvergenceError(f"{error}{where}", record.build(record)) from error
    return record.build(record)


def _save(record: Record, path: str | Path, comm: Any) -> None:
    """Write the checkpoint on rank 0; every rank raises if that failed."""
    problem = None
    if comm.rank == 0:
        try:
            record.build(record).save(path)
        except MeshError as error:
            problem = str(error)
    problem = comm.bcast(problem)
    if problem is not None:
        kept = f"; the {record.reached - 1} increments saved before are unharmed" if record.reached > 1 else ""
        raise CheckpointError(f"{problem}{kept}")
