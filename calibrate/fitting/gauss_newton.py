"""One Gauss-Newton loop with bounds and a prior: linearise, solve the linear problem in its bounds, accept or shorten the step.

In: a function that gives the problem linearised about a point, a start, an acceptance rule. Out: `Solution`, which says why it
stopped. What a point is (numbers, a base with its effects) the problem alone knows. The rules are step halving, and the damping
of Levenberg (1944) and Marquardt (1963).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calibrate.fitting.stopping import Stop

Array = NDArray[np.float64]


class Point(Protocol):
    """Where the problem is evaluated. objective: squared residual and prior there; infinite where it is not defined."""

    @property
    def objective(self) -> float: ...


class Linearised[P: Point](Protocol):
    """The problem linearised about `point`: residual, Jacobian, bounds and prior.

    slack: by how much the objective may rise because the Jacobian is not its slope exactly.
    """

    @property
    def point(self) -> P: ...

    @property
    def slack(self) -> float: ...

    def solve(self, damping: float) -> Array:
        """Unknowns (k,) that minimise the damped linear problem within the bounds."""
        ...

    def moved(self, unknowns: Array, fraction: float) -> P:
        """The point a fraction of the way to the unknowns (k,)."""
        ...

    def is_small(self, unknowns: Array, moved: P) -> bool:
        """Whether the step to `moved` changes so little that the fit has converged."""
        ...

    def is_minimum(self, unknowns: Array) -> bool:
        """Whether the step to the unknowns (k,) promises no fall of the objective that matters."""
        ...


@dataclass(frozen=True, eq=False)
class Step[P: Point]:
    """A step: the unknowns (k,) asked for, the fraction taken, the point reached (None: none was accepted), the next damping."""

    unknowns: Array
    fraction: float
    moved: P | None
    damping: float = 0.0


class Acceptance(Protocol):
    """How a step is found and when it is accepted. damping: at the first step."""

    @property
    def damping(self) -> float: ...

    def step[P: Point](self, linear: Linearised[P], damping: float) -> Step[P]: ...


@dataclass(frozen=True)
class Halving:
    """The step is halved until the objective rises by no more than the factor `rise` and the slack; the last trial is taken anyway."""

    trials: int = 5
    rise: float = 1.02
    damping: float = 0.0

    def step[P: Point](self, linear: Linearised[P], damping: float) -> Step[P]:
        """The longest accepted step, or the shortest one tried."""
        unknowns = linear.solve(0.0)
        for k in range(self.trials):
            moved = linear.moved(unknowns, 0.5**k)
            if moved.objective <= self.rise * linear.point.objective + linear.slack:  # False for what is not finite
                break
        return Step(unknowns, 0.5**k, moved)


@dataclass(frozen=True)
class Damping:
    """The damping is raised until the objective falls; above `most` no step is accepted."""

    damping: float = 1e-3
    most: float = 1e6

    def step[P: Point](self, linear: Linearised[P], damping: float) -> Step[P]:
        """The first step that lowers the objective; without one, the step that was tried first."""
        first = None
        while damping < self.most:
            unknowns = linear.solve(damping)
            first = unknowns if first is None else first
            moved = linear.moved(unknowns, 1.0)
            if moved.objective < linear.point.objective:
                return Step(unknowns, 1.0, moved, max(damping / 5, 1e-8))
            damping = 10 * max(damping, 1e-4)
        assert first is not None
        return Step(first, 0.0, None, damping)


@dataclass(frozen=True, eq=False)
class Solution[P: Point, L]:
    """point: where the fit ended. linear: the problem about the point before the last step. step: the last one."""

    point: P
    linear: L
    step: Step[P]
    reason: Stop
    iterations: int


def minimise[P: Point, L: Linearised](
    linearise: Callable[[P, int], L], start: P, rule: Acceptance, iterations: int
) -> Solution[P, L]:
    """Gauss-Newton steps from `start`. linearise: called with the point and the number of the iteration, from 0.

    Raises what `linearise` raises. `iterations` is at least 1.
    """
    point, damping = start, rule.damping
    for count in range(iterations):
        linear = linearise(point, count)
        step = rule.step(linear, damping)
        if step.moved is None:
            reason = Stop.CONVERGED if linear.is_minimum(step.unknowns) else Stop.NO_DESCENT
            return Solution(point, linear, step, reason, count + 1)
        point, damping = step.moved, step.damping
        if not np.isfinite(point.objective):
            return Solution(point, linear, step, Stop.NOT_FINITE, count + 1)
        if linear.is_small(step.unknowns, point):
            return Solution(point, linear, step, Stop.CONVERGED, count + 1)
    return Solution(point, linear, step, Stop.ITERATION_LIMIT, iterations)
