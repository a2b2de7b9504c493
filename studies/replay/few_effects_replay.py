"""Few effects that leave least of the fields of a replay, see `calibrate.diagnosis.replayed.few_effects`.

In: the `Problem` of a diagnosis, a neo-Hookean base, effects and priors. Out: `FewEffects`, with what the forces add: a factor on the base and effects with a memory, as of other models that are updated.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.evidence.priors import Priors
from calibrate.diagnosis.evidence.signatures import prior_deviations
from calibrate.diagnosis.parameters import is_null
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.replayed.few_effects import Candidate, FewEffects, FittedSet, few_effects
from calibrate.diagnosis.replayed.observations import ReplayErrors
from calibrate.diagnosis.replayed.updating import Priors as UpdatePriors
from calibrate.diagnosis.replayed.updating import Updated, update
from calibrate.diagnosis.score_tests import untestable
from calibrate.effects import Effect
from calibrate.effects.chain import Additions
from calibrate.effects.chain.true_surface import is_expressed
from calibrate.fitting.resumable import SILENT, Resumable
from studies.errors import OptionError
from studies.replay.compared_test import ComparedTest
from studies.replay.fitted_replays import EACH, Replays, other_times
from studies.replay.model_law import STRIP, is_solved

Array = NDArray[np.float64]
PICTURES = 4  # of a test that was fitted: more tell little, as what a model misses persists over the load
WORSE = 1.05  # times the field error, which forces may cost
FEW = 2  # amplitudes, at most: more are a series that describes any smooth field


@dataclass(frozen=True, eq=False)
class FewEffectsReplays:
    """Replays of a problem with few effects beside neo-Hooke, c (n,), MPa. levels: names of tests whose forces do not count, as they have a level of their own."""

    problem: Problem
    c: Array
    effects: Sequence[Effect]
    priors: Priors
    levels: Collection[str] = ()
    say: Resumable = SILENT

    def by_fields(self) -> FewEffects:
        """Those that leave least of the fields. Raises `OptionError` where neo-Hooke has no equilibrium or no displacement is free, and the errors of `ComparedTest.replayed`."""
        replays = self._of(PICTURES)
        if not any(len(test.layout.weights) for test in replays.tests):
            raise OptionError("the motion of the grips prescribes every point, so that no displacement tells effects apart")  # fmt: skip
        candidates = [one for one in self._candidates if not one.effect.remembers and len(one.deviations) <= FEW]
        found = few_effects(replays, self.c, candidates, self.say)
        if found is None:
            raise OptionError(f"neo-Hooke has no equilibrium to start from: {replays.failure}")
        return found

    def with_forces(self, found: FewEffects, best: FittedSet | None) -> Updated:
        """One of their sets, or neo-Hooke alone, updated by forces: the first of these that does not take the fields further from what was measured than they were, or than neo-Hooke has them. All, with
        effects with a memory beside them; those with a memory alone, as the rest stays; the factor alone. Raises `FitError` where no force is known, `OptionError` without an equilibrium."""
        remembered = [one for one in self._candidates if one.effect.remembers and not one.effect.has_spring]
        fitted = () if best is None else best.additions
        additions = (*fitted, *(one.at_null(one.shapes[0]) for one in remembered))
        known = {} if best is None else dict(best.priors)
        known |= {one.effect.name: (np.array([p.null for p in one.effect.amplitudes]), one.deviations) for one in remembered}  # fmt: skip
        replays = self._updates

        def updated(way: int, some: Additions, others: Sequence[Additions], of_memory: bool) -> Updated:
            self.say(f"few effects updated by the forces of their replays, way {way} of at most 3")
            new = update(replays, found.c, some, known, others, of_memory)
            if new is None:
                raise OptionError(f"the few effects have no equilibrium to start from: {replays.failure}")
            return new

        def is_kept(new: Updated) -> bool:
            return new.after.field <= WORSE * max(new.before.field, self._nearest)

        everything = updated(1, additions, other_times(additions, self.problem), False)
        new = _without_weak(replays, everything, known, False)
        if remembered and not is_kept(new):
            start = _with_memory_of(everything.additions, additions)
            new = _without_weak(replays, updated(2, additions, [start], True), known, True)
        return new if is_kept(new) else updated(3, fitted, (), True)

    def _of(self, pictures: int) -> Replays:
        return Replays([ComparedTest(part, pictures, False) for part in self.problem.trained], self.levels)

    @cached_property
    def _updates(self) -> Replays:
        """Of the pictures that models are updated by."""
        return self._of(EACH)

    @cached_property
    def _nearest(self) -> float:
        """Field error of neo-Hooke in these, mm, at any level."""
        replayed = self._updates(self.c, ())
        if replayed is None:
            raise OptionError(f"neo-Hooke has no equilibrium in all pictures: {self._updates.failure}")
        return ReplayErrors.of(replayed.rows, ~replayed.rows.held).field

    @cached_property
    def _candidates(self) -> list[Candidate]:
        """Effects that can be tested with these data, and that finite elements have; of several tests, alike in all."""
        return [
            Candidate(effect, tuple(self.problem.shapes(effect)), prior_deviations(self.problem, effect, self.priors))
            for effect in self.effects
            if untestable(self.problem, effect, alike=True) is None
            and effect.beside is None
            and effect.name != STRIP
            and (is_solved(effect.name) or is_expressed(effect))
        ]


def _with_memory_of(found: Additions, additions: Additions) -> Additions:
    """The additions, those with a memory as they were found."""
    return tuple(b if a.effect.remembers else a for a, b in zip(additions, found, strict=True))


def _without_weak(replays: Replays, found: Updated, known: UpdatePriors, of_memory: bool) -> Updated:
    """Fitted again without effects with a memory that the forces do not tell from none."""
    pairs = list(zip(found.additions, found.deviations, strict=True))
    strong = tuple(a for a, d in pairs if not (a.effect.remembers and is_null(a, np.diag(np.square(d)))))
    if len(strong) == len(pairs):
        return found
    again = update(replays, found.c, strong, known, (), of_memory)
    return found if again is None else replace(again, before=found.before)
