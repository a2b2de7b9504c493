"""Load stepping: a problem and its load factors in, equilibrium states out, with prediction and bisection."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from forward.errors import ConvergenceError

Array = NDArray[np.float64]
Unknowns = tuple[Array, ...]
HISTORY = 3  # states that a prediction uses


class Outcome(Protocol):
    """How a solve ended: in equilibrium or not, iterations of the solver, text for the user."""

    @property
    def converged(self) -> bool: ...
    @property
    def iterations(self) -> int: ...
    @property
    def text(self) -> str: ...


class Problem(Protocol):
    """What can be stepped: settable unknowns (displacements, mm, and what else there is) and a solve at a load
    factor."""

    @property
    def unknowns(self) -> Unknowns: ...
    @unknowns.setter
    def unknowns(self, values: Unknowns) -> None: ...

    def solve(self, load_factor: float) -> Outcome: ...


@dataclass(frozen=True)
class State:
    """Equilibrium at a load factor: unknowns, and the solver's iterations since the last reported state."""

    load_factor: float
    unknowns: Unknowns
    iterations: int = 0


def steps(
    problem: Problem, load_factors: Sequence[float], states: Sequence[State], max_bisections: int
) -> Iterator[State]:
    """States at `load_factors`, one by one, from the known `states`.

    A failed step is rolled back and halved, up to `max_bisections` times. An increment starts from reported states
    alone, so that a resumed run repeats what an uninterrupted one does. Raises `ConvergenceError`.
    """
    reported = list(states)[-HISTORY:]
    for target in load_factors:
        known = list(reported)
        iterations = 0
        smallest = (target - known[-1].load_factor) / 2**max_bisections
        step = target - known[-1].load_factor
        while known[-1].load_factor != target:
            start = known[-1].load_factor
            step = min(step, target - start)
            trial = target if target - (start + step) < 1e-12 else start + step
            problem.unknowns = predict(known, trial)
            outcome = problem.solve(trial)
            iterations += outcome.iterations
            if outcome.converged:
                known.append(State(trial, problem.unknowns, iterations))
                continue
            problem.unknowns = known[-1].unknowns
            step /= 2
            if step < smallest * (1 - 1e-9):
                raise ConvergenceError(
                    f"no equilibrium beyond {start:.4g} of the load: {outcome.text} in steps down to "
                    f"{2 * step:.2g}. Load less, use more increments, refine the mesh or check the material"
                )
        reported = [*reported, known[-1]][-HISTORY:]
        yield known[-1]


def predict(known: Sequence[State], load_factor: float) -> Unknowns:
    """The polynomial through the last states, three at most, continued to `load_factor`."""
    last = known[-HISTORY:]
    weights = []
    for a in last:
        others = [b.load_factor for b in last if b is not a]
        weights.append(np.prod([(load_factor - t) / (a.load_factor - t) for t in others]))
    fields = zip(*(state.unknowns for state in last), strict=True)
    return tuple(sum(w * x for w, x in zip(weights, field, strict=True)) for field in fields)
