"""Replays that the parameters of a model are fitted by, see `calibrate.diagnosis.replayed.few_effects` and `updating`.

In: tests. Out: `Replays`, a function of base and effects. Only increments that were fitted are solved, and those before them that a history needs.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.replayed.parameter_spread import Directions
from calibrate.diagnosis.replayed.replayed_rows import ReplayedRows
from calibrate.effects.chain import Additions
from calibrate.errors import ImpossibleCorrectionError
from forward.errors import ForwardError
from studies.replay.compared_test import ComparedTest, ReplayedModel
from studies.replay.flat_rows import judging, observations
from studies.replay.parameter_changes import Departure, of_parameters

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
EACH = 12  # increments of a test that are compared


def other_times(additions: Additions, problem: Problem) -> list[Additions]:
    """The same effects with every other relaxation time that the score tests try; its amplitude is left as it is."""
    found = []
    for i, a in enumerate(additions):
        if a.effect.stage == "relaxation":
            found += [
                (*additions[:i], replace(a, shape=shape), *additions[i + 1 :]) for shape in problem.shapes(a.effect)
            ]
    return found


@dataclass(eq=False)
class Replays:
    """As `update` calls them. levels: names of tests whose forces set no level and are not fitted."""

    tests: list[ComparedTest]
    levels: Collection[str] = ()
    failure: str = field(default="", init=False)

    def __call__(self, c: Array, additions: Additions) -> ReplayedRows | None:
        """A law that cannot be solved has no rows, nor has a correction that leaves no test, as a lag that puts a picture before the start."""
        model = ReplayedModel(c, tuple(a for a in additions if not a.is_null))
        try:
            pairs = [test.replayed(model, True) for test in self.tests]
        except (ForwardError, ImpossibleCorrectionError) as error:
            self.failure = str(error)
            return None
        rows = observations(self.tests, [rows for rows, _ in pairs])
        rows = replace(rows, judges=judging(rows, self.tests, (), self.levels))
        each = list(zip(self.tests, (changes for _, changes in pairs), strict=True))
        starts = [Departure(*one, c, additions) for one in each]

        def near(other: Array, others: Additions) -> Array:
            return rows.residual + np.concatenate([start.to(other, others) for start in starts])

        def slopes(directions: Directions, used: Mask) -> Array:
            return np.concatenate([of_parameters(*one, directions, 1.0, used) for one in each])

        return ReplayedRows(rows, near, slopes, tuple(test.part.chain.data for test in self.tests))
