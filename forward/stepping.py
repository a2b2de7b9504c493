"""Load stepping: a problem and its load factors in, equilibrium states out, with prediction and bisection."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from forward.errors import ConvergenceError

Array = NDArray[np.float64]


class Outcome(Protocol):
    """How a solve ended."""

    @property
    def converged(self) -> bool: ...
    @property
    def iterations(self) -> int: ...
    @property
    def text(self) -> str: ...


class Problem(Protocol):
    """What can be stepped: settable unknowns and a solve at a load factor."""

    displacements: Array

    def solve(self, load_factor: float) -> Outcome: ...


@dataclass(frozen=True)
class State:
    """Equilibrium at a load factor: unknowns, and the solver's iterations since the last reported state."""

    load_factor: float
    displacements: Array
    iterations: int = 0


def steps(
    problem: Problem, load_factors: Sequence[float], states: Sequence[State], max_bisections: int
) -> Iterator[State]:
    """States at `load_factors`, one by one, from the known `states` (the last two serve the prediction).

    A failed step is rolled back and halved, up to `max_bisections` times. Raises `ConvergenceError`.
    """
    known = list(states)[-2:]
    for target in load_factors:
        iterations = 0
        smallest = (target - known[-1].load_factor) / 2**max_bisections
        step = target - known[-1].load_factor
        while known[-1].load_factor != target:
            start = known[-1].load_factor
            step = min(step, target - start)
            trial = target if target - (start + step) < 1e-12 else start + step
            problem.displacements = predict(known, trial)
            outcome = problem.solve(trial)
            iterations += outcome.iterations
            if outcome.converged:
                known = [known[-1], State(trial, problem.displacements, iterations)]
                continue
            problem.displacements = known[-1].displacements
            step /= 2
            if step < smallest * (1 - 1e-9):
                raise ConvergenceError(
                    f"no equilibrium beyond {start:.4g} of the load: {outcome.text} in steps down to "
                    f"{2 * step:.2g}. Load less, use more increments, refine the mesh or check the material"
                )
        yield known[-1]


def predict(known: Sequence[State], load_factor: float) -> Array:
    """Secant through the last two states, or the last state if there is only one."""
    if len(known) < 2:
        return known[-1].displacements
    before, last = known[-2:]
    ratio = (load_factor - last.load_factor) / (last.load_factor - before.load_factor)
    return last.displacements + ratio * (last.displacements - before.displacements)
