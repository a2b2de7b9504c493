"""Replays that the parameters of a model are updated by, see `calibrate.diagnosis.replayed.updating`.

In: the `Problem` of a diagnosis and a fit of its effects. Out: `Updated`. An effect that neither the forward model nor a correction of what was measured has is left out, and what it
does to the forces is left to the others. Only increments that were fitted are solved, and those before them that a history needs.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.joint.shares import Everything, Share
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.replayed.parameter_spread import Directions
from calibrate.diagnosis.replayed.updating import ReplayedRows, Updated, update
from calibrate.effects.chain import Additions
from calibrate.effects.chain.true_surface import is_expressed
from calibrate.effects.support.effect_data import Data
from forward.errors import ForwardError
from studies.errors import OptionError
from studies.replay.compared_test import ComparedTest, ReplayedModel
from studies.replay.flat_rows import observations
from studies.replay.model_law import is_solved
from studies.replay.parameter_changes import Departure, of_parameters

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
EACH = 12  # increments of a test that are compared


def updated(problem: Problem, one: Everything) -> Updated:
    """Effects of a fit that are not at their null values, and all with a memory. Raises `OptionError` where the model as it was fitted cannot be
    solved, and the errors of `ComparedTest.replayed`."""
    replays = Replays([ComparedTest(part, EACH, False) for part in problem.trained])
    there = [a for a in one.fit.additions if not a.is_null]
    has_law = {a.effect.name for a in one.fit.additions if is_solved(a.effect.name) or is_expressed(a.effect)}
    used = {a.effect.name for a in there} | {a.effect.name for a in one.fit.additions if a.effect.remembers}
    additions = tuple(a for a in one.fit.additions if a.effect.name in used & has_law)
    left_out = tuple(a.effect.name for a in there if a.effect.name not in has_law)
    priors = {share.effect.name: _prior(share) for share in one.shares}
    found = update(replays, one.fit.c, additions, priors, other_times(additions, problem.trained[0].chain.data))
    if found is None:
        raise OptionError(f"the plausible effects have no equilibrium to start from: {replays.failure}")
    return replace(found, left_out=left_out)


def other_times(additions: Additions, data: Data) -> list[Additions]:
    """The same effects with every other time that the score tests try, of a material that remembers one; its amplitude is left as it is."""
    found = []
    for i, a in enumerate(additions):
        if a.effect.remembers and a.shape:
            found += [
                (*additions[:i], replace(a, shape=tuple(shape)), *additions[i + 1 :])
                for shape in a.effect.shape_values(data)
            ]
    return found


def _prior(share: Share) -> tuple[Array, Array]:
    """Mean and standard deviations of its amplitudes: those of the fit to the equations, or before the test where it has a memory."""
    if share.effect.remembers:
        return np.array([p.null for p in share.effect.amplitudes]), np.array(share.priors)
    return np.array(share.amplitudes), np.array(share.deviations)


@dataclass(eq=False)
class Replays:
    """As `update` calls them."""

    tests: list[ComparedTest]
    failure: str = field(default="", init=False)

    def __call__(self, c: Array, additions: Additions) -> ReplayedRows | None:
        """A law that cannot be solved has no rows."""
        model = ReplayedModel(c, tuple(a for a in additions if not a.is_null))
        try:
            pairs = [test.replayed(model, True) for test in self.tests]
        except ForwardError as error:
            self.failure = str(error)
            return None
        rows = observations(self.tests, [rows for rows, _ in pairs])
        each = list(zip(self.tests, (changes for _, changes in pairs), strict=True))
        starts = [Departure(*one, c, additions) for one in each]

        def near(other: Array, others: Additions) -> Array:
            return rows.residual + np.concatenate([start.to(other, others) for start in starts])

        def slopes(directions: Directions, used: Mask) -> Array:
            return np.concatenate([of_parameters(*one, directions, 1.0, used) for one in each])

        return ReplayedRows(rows, near, slopes)
