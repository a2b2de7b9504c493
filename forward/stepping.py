"""Load stepping: a problem and a path of loading in, equilibria out, with prediction and bisection.

A path is load factors at times, joined by straight lines; it may turn. An increment ends at a moment of the path. It is
solved in `substeps` equal parts, which are halved where no equilibrium is found; or in the parts that the readings of a load cell, moments
on the way, divide it into. A problem with a history (viscosity, softening) has its state variables committed after each part.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from forward.errors import ConvergenceError

Array = NDArray[np.float64]
Unknowns = tuple[Array, ...]
History = dict[str, Array]
HISTORY = 3  # states that a prediction uses
DISTINCT = 1e-6  # load factors that are nearer than this are one place of the polynomial


class Outcome(Protocol):
    """How a solve ended: in equilibrium or not, iterations of the solver, text for the user."""

    @property
    def converged(self) -> bool: ...
    @property
    def iterations(self) -> int: ...
    @property
    def text(self) -> str: ...


class Problem(Protocol):
    """What can be stepped.

    unknowns: displacements, mm, and what else there is; history: state variables by name, of the last committed
    equilibrium; step: from there to a load factor, in `duration` (s); commit: take the present equilibrium as the past
    of the next step; nodal_forces (n, d), N, and energy, N mm, of the present one, read before it is committed.
    """

    @property
    def unknowns(self) -> Unknowns: ...
    @unknowns.setter
    def unknowns(self, values: Unknowns) -> None: ...
    @property
    def history(self) -> History: ...
    @history.setter
    def history(self, values: History) -> None: ...

    def step(self, load_factor: float, duration: float) -> Outcome: ...
    def commit(self) -> None: ...
    def nodal_forces(self) -> Array: ...
    def energy(self) -> float: ...


class Elastic:
    """Base of the problems without a history: the state is the unknowns, whatever came before."""

    def solve(self, load_factor: float) -> Outcome:
        """Equilibrium at a load factor, from the present unknowns."""
        raise NotImplementedError

    def step(self, load_factor: float, duration: float) -> Outcome:
        """Equilibrium at a load factor; time plays no part."""
        return self.solve(load_factor)

    def commit(self) -> None:
        """Nothing is remembered."""

    @property
    def history(self) -> History:
        """No state variables."""
        return {}

    @history.setter
    def history(self, values: History) -> None:
        """Take none."""


@dataclass(frozen=True)
class Moment:
    """A point of the path: time, s (where time plays no part, the load factor), and load factor."""

    time: float
    load_factor: float

    def towards(self, other: Moment, share: float) -> Moment:
        """The point at a share, 0 to 1, of the straight line to another moment."""
        if share == 1.0:
            return other
        return Moment(
            self.time + share * (other.time - self.time),
            self.load_factor + share * (other.load_factor - self.load_factor),
        )


REST = Moment(0.0, 0.0)


@dataclass(frozen=True)
class State:
    """Equilibrium at a moment: unknowns, and the solver's iterations since the last reported state."""

    moment: Moment
    unknowns: Unknowns
    iterations: int = 0


@dataclass(frozen=True)
class Reading:
    """Nodal forces (n, d), N, at a moment on the way to an increment."""

    moment: Moment
    forces: Array


@dataclass(frozen=True)
class Increment:
    """A reported state with its nodal forces (n, d), N, stored energy, N mm, the committed state variables, and the readings on the way
    to it."""

    state: State
    forces: Array
    energy: float
    history: History = field(default_factory=dict)
    readings: tuple[Reading, ...] = ()


def proportional(n_increments: int) -> list[Moment]:
    """Equal steps to the whole load."""
    return [Moment(float(t), float(t)) for t in np.arange(1, n_increments + 1) / n_increments]


def steps(
    problem: Problem,
    path: Sequence[Moment],
    states: Sequence[State],
    max_bisections: int,
    substeps: int = 1,
    readings: Sequence[Moment] = (),
) -> Iterator[Increment]:
    """Equilibria at the moments of `path`, one by one, from the reported `states`, the first of which is at rest.

    readings: moments on the way at which forces are read; straight lines join them. A failed step is rolled back and halved, up to `max_bisections`
    times. An increment starts from reported states alone, so that a resumed run repeats what an uninterrupted one does. Raises `ConvergenceError`.
    """
    reported: list[State] = []
    for state in states:
        reported = _distinct([*reported, state])
    for target in path:
        between = [moment for moment in readings if reported[-1].moment.time < moment.time < target.time]
        increment = _increment(problem, [*between, target], reported, max_bisections, substeps)
        reported = _distinct([*reported, increment.state])
        yield increment


def _increment(
    problem: Problem, moments: Sequence[Moment], known: list[State], max_bisections: int, substeps: int
) -> Increment:
    """The equilibrium at the last of `moments`, with readings at those before; the last known state is the increment before."""
    parts = -(-substeps // len(moments))
    read: list[Reading] = []
    iterations = 0
    for moment in moments[:-1]:
        known = _part(problem, moment, known, max_bisections, parts)
        iterations += known[-1].iterations
        read.append(Reading(moment, problem.nodal_forces()))  # before it is committed: forces depend on the past
        problem.commit()
    last = _part(problem, moments[-1], known, max_bisections, parts)[-1]
    return _committed(problem, replace(last, iterations=iterations + last.iterations), tuple(read))


def _part(problem: Problem, target: Moment, known: list[State], max_bisections: int, substeps: int) -> list[State]:
    """Known states, the last of them the equilibrium at `target`, which is not committed yet."""
    start, known = known[-1].moment, list(known)
    share, smallest = 1 / substeps, 0.5**max_bisections / substeps
    done, iterations = 0.0, 0
    while True:
        end = 1.0 if done + share > 1 - 1e-12 else done + share
        trial = start.towards(target, end)
        problem.unknowns = predict(known, trial.load_factor)
        outcome = problem.step(trial.load_factor, (end - done) * (target.time - start.time))
        iterations += outcome.iterations
        if outcome.converged:
            state = State(trial, problem.unknowns, iterations)
            known = _distinct([*known, state])
            if end == 1.0:
                return known
            problem.commit()
            done = end
            continue
        problem.unknowns = known[-1].unknowns
        share /= 2
        if share < smallest * (1 - 1e-9):
            step = 2 * share * abs(target.load_factor - start.load_factor)
            raise ConvergenceError(_failure(known[-1].moment, outcome, step))


def _committed(problem: Problem, state: State, readings: tuple[Reading, ...]) -> Increment:
    """Report the state; its forces are read first, as they depend on the past."""
    forces, energy = problem.nodal_forces(), problem.energy()
    problem.commit()
    return Increment(state, forces, energy, problem.history, readings)


def _failure(last: Moment, outcome: Outcome, step: float) -> str:
    when = "" if last.time == last.load_factor else f", {last.time:.4g} s after the start"
    return (
        f"no equilibrium beyond {last.load_factor:.4g} of the load{when}: {outcome.text} in steps down to "
        f"{step:.2g}. Use more increments (more pictures of a test), load less, refine the mesh, or check the material: whether it is stable, and meant for such strains"
    )


def _distinct(states: Sequence[State]) -> list[State]:
    """The last states, three at most, at different load factors, through which a polynomial can be laid."""
    kept: list[State] = []
    for state in reversed(states):
        factor = state.moment.load_factor
        if len(kept) < HISTORY and all(abs(factor - k.moment.load_factor) > DISTINCT for k in kept):
            kept.insert(0, state)
    return kept


def predict(known: Sequence[State], load_factor: float) -> Unknowns:
    """The polynomial through the last states, three at most, continued to `load_factor`."""
    last = known[-HISTORY:]
    weights = []
    for a in last:
        others = [b.moment.load_factor for b in last if b is not a]
        weights.append(np.prod([(load_factor - t) / (a.moment.load_factor - t) for t in others]))
    fields = zip(*(state.unknowns for state in last), strict=True)
    return tuple(sum(w * x for w, x in zip(weights, values, strict=True)) for values in fields)
