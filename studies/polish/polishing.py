"""Polish of a calibrated law: Gauss-Newton on all displacements and forces of the replayed test.

In: a test and the law of its calibration. Out: `Polished`. Each iteration linearises the replays (`replay_equations`), refits the law to the linear equations,
and replays the test with it and with the motion of the grips that is then best. A step that raises chi-square is halved.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calibrate.fitting.gauss_newton import Halving, minimise
from calibrate.fitting.stopping import Stop
from studies.polish.replay_equations import Equations, Point, ReplayedTest
from studies.polish.varied_law import VariedLaw

Array = NDArray[np.float64]
ITERATIONS = 8
SMALL = 0.3  # change of all equations by the last step, in standard deviations of one


@dataclass(frozen=True, eq=False)
class LinearisedReplay:
    """The replays linearised about `point`, as `calibrate.fitting.gauss_newton` takes them; the unknowns are the parameters of the law."""

    test: ReplayedTest = field(repr=False)
    equations: Equations
    slack: float = 1.0

    @property
    def point(self) -> Point:
        """Where they are linearised."""
        return self.equations.point

    def solve(self, damping: float) -> Array:
        """Parameters (p,) of the law that meets the linear equations best."""
        G, residual = self.equations.rows
        return self.point.law.fitted(G, residual + G @ self.point.law.coefficients)

    def moved(self, unknowns: Array, fraction: float) -> Point:
        """The replay a fraction of the way to other parameters (p,)."""
        law = self.point.law
        return self.test.moved(self.equations, law.at(law.parameters + fraction * (unknowns - law.parameters)))

    def is_small(self, unknowns: Array, moved: Point) -> bool:
        """Whether the step changes the equations by less than `SMALL`."""
        return self._size(moved.law) < SMALL

    def is_minimum(self, unknowns: Array) -> bool:
        """Whether the step that was asked for does."""
        return self._size(self.point.law.at(unknowns)) < SMALL

    def _size(self, law: VariedLaw) -> float:
        G, _ = self.equations.rows
        return float(np.linalg.norm(G @ (law.coefficients - self.point.law.coefficients)))


@dataclass(frozen=True, eq=False)
class Polished:
    """before: equations about the law as it was; after: about the polished one, with the sensitivities of the point before the last, small step."""

    before: Equations
    after: Equations
    reason: Stop
    iterations: int


def polish(test: ReplayedTest, law: VariedLaw) -> Polished:
    """From the law of a calibration. Raises `ConvergenceError` where it has no equilibrium with the motion as measured."""
    start = test.linearised(test.start(law))

    def linearise(point: Point, count: int) -> LinearisedReplay:
        return LinearisedReplay(test, start if count == 0 else test.linearised(point))

    found = minimise(linearise, start.point, Halving(), ITERATIONS)
    return Polished(start, test.about(found.point, found.linear.equations), found.reason, found.iterations)
