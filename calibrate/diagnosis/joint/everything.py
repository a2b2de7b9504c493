"""All effects at once, each as strong as its prior allows, for tests that no few effects explain.

In: a `Problem`, effects, priors. Out: `Everything`. Beside neo-Hooke, so that no flexible base hides an effect; the upturn and the second
invariant, with their priors, make it Yeoh's or Mooney and Rivlin's. An effect that ends far beyond its prior stands in for something else, and lets
others do so: in a second fit none may. What none of them explains is a smooth discrepancy (`discrepancy`), and larger noise in the equations without a load (`discrepancy.field_variance`): a model that is
wrong in places would else give up the forces, which are measured, for them. Both variances are those of what neo-Hooke leaves: updated with the fit they would grow without
end, as what is not seen may be fitted badly.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.diagnosis import base_functions, effect_fit, model_weights, score_tests
from calibrate.diagnosis import problem as equations
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.evidence.priors import FAR, Priors
from calibrate.diagnosis.evidence.signatures import prior_deviations
from calibrate.diagnosis.joint import discrepancy
from calibrate.diagnosis.joint import fit as joint_fit
from calibrate.diagnosis.joint.equations import Widths
from calibrate.diagnosis.joint.fit import Joint
from calibrate.diagnosis.joint.shares import Everything, Share
from calibrate.diagnosis.misfit import Misfit, misfit
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.score_tests import Score
from calibrate.effects import Effect
from calibrate.effects.chain import Addition, Additions

Array = NDArray[np.float64]
Say = Callable[[str], None]
Start = tuple[Array, Additions]  # base and effects
# left out but of a fit of plausible effects: ten smooth amplitudes without a law and without a limit are a second discrepancy, and neither can be told from the other
SMOOTH = {"initial warp"}
FIRST, STEPS = 5, 30  # steps from every start, and from the best


def fit_everything(
    problem: Problem,
    effects: Sequence[Effect],
    priors: Priors,
    say: Say = lambda text: None,
    field_variance: float | None = None,
) -> Everything:
    """Of the training rows of a problem, with its weights. field_variance: over that of noise, None for that of what neo-Hooke leaves. Raises `FitError` where a fit has no finite start or nothing can be tested."""
    problem = simple_base(problem)
    base = effect_fit.refit(
        problem, base_functions.first_guess([(part.assembled, part.train.rows) for part in problem.trained]), ()
    )
    variance = discrepancy.field_variance(problem, base.c) if field_variance is None else field_variance
    if variance > 1:
        problem = model_weights.with_field_variance(problem, variance)
        base = effect_fit.refit(problem, base.c, ())
    scores = {score.effect.name: score for score in score_tests.score(problem, base, effects) if score.is_tested}
    additions = candidates(
        [one for name, one in scores.items() if name not in SMOOTH],
        [effect.name for effect in effects if effect.nested_in in scores],
    )
    if not additions:
        raise errors.FitError("no effect of the catalogue can be tested with these data, so that none can be fitted")
    widths = {name: prior_deviations(problem, score.effect, priors) for name, score in scores.items()}
    search = _Search(problem, base, scores, widths, discrepancy.directions(problem), say)
    found = search.to_the_end(search.best_start(additions))
    plausible = search.plausible(found)
    return replace(
        found,
        plausible=None if plausible is None else replace(plausible, field_variance=variance),
        field_variance=variance,
    )


@dataclass(frozen=True, eq=False)
class _Search:
    """Fits of several effects beside a base fit; widths: of the priors, reach: of these no amplitude goes beyond; D (N, k): directions of the discrepancy."""

    problem: Problem
    base: Fit
    scores: Mapping[str, Score]
    widths: Widths
    D: Array
    say: Say
    reach: float = np.inf

    @cached_property
    def with_discrepancy(self) -> Problem:
        """The problem with the discrepancy of what the base leaves."""
        variance = discrepancy.variance_of(self.base.residual, self.D)
        return discrepancy.with_discrepancy(self.problem, self.D, variance)

    def best_start(self, additions: Additions, *others: Start) -> Start:
        """A few steps from the base with the shapes of the score tests, and from the shortest of the times that the material remembers: relaxation that is fast
        beside the increments looks like an offset of force or time to a score. And from other starts."""
        data = self.problem.trained[0].chain.data
        shortest = tuple(
            replace(a, shape=a.effect.shape_values(data)[0]) if a.effect.remembers and a.shape else a for a in additions
        )
        starts = [additions]
        if any(a.shape != b.shape for a, b in zip(additions, shortest, strict=True)):
            starts.append(shortest)
        found = []
        every = [*((self.base.c, start) for start in starts), *others]
        for i, (c, start) in enumerate(every):
            self.say(f"all {len(additions)} effects at once, start {i + 1} of {len(every)}")
            found.append(joint_fit.fit(self.with_discrepancy, c, start, self.widths, FIRST, self.reach))
        best = min(found, key=lambda one: one.objective)
        return best.c, best.additions

    def to_the_end(self, start: Start) -> Everything:
        """The fit, what it says of each effect, and its errors. Effects that a few steps left at none wait until the others are at the end: most stay there."""
        c, additions = start
        self.say(f"all {len(additions)} effects at once, to the end")
        acting = tuple(a for a in additions if not a.is_null)
        if 0 < len(acting) < len(additions):
            first = joint_fit.fit(self.with_discrepancy, c, acting, self.widths, STEPS, self.reach)
            moved = {a.effect.name: a for a in first.additions}
            c, additions = first.c, tuple(moved.get(a.effect.name, a) for a in additions)
        fit = joint_fit.fit(self.with_discrepancy, c, additions, self.widths, STEPS, self.reach)
        left = discrepancy.variance_of(equations.residual(self.problem, fit.c, fit.additions), self.D)
        before_it, after_it = (
            (_misfit(self.problem, c, some, held=False), misfit(self.problem, c, some, held=True))
            for c, some in ((self.base.c, ()), (fit.c, fit.additions))
        )
        return Everything(
            fit, _shares(fit, self.widths), before_it, after_it, left, fit.dispersion, neo_hooke=self.base.c
        )

    def plausible(self, found: Everything) -> Everything | None:
        """The same with no amplitude beyond what its prior allows, smooth effects too; None where none is. It starts where that fit ended, and anew: other effects make up for what
        it must not have."""
        if not any(one.is_far for one in found.shares):
            return None
        bounded = replace(self, reach=FAR)
        smooth = candidates([self.scores[name] for name in SMOOTH if name in self.scores])
        anew = (*candidates([self.scores[a.effect.name] for a in found.fit.additions]), *smooth)
        return bounded.to_the_end(bounded.best_start(anew, (found.fit.c, (*found.fit.additions, *smooth))))


def candidates(scores: Sequence[Score], nested: Sequence[str] = ()) -> Additions:
    """Tested effects at their null values, with the shapes that the score test found best; amplitudes that shapes need are
    started at a third of a typical one. nested: effects left out, because a more general one holds them."""
    result = []
    for one in scores:
        if not one.is_tested or one.effect.name in nested:
            continue
        values = [
            float(np.clip(p.null + 0.3 * p.typical, p.lower, p.upper)) if one.effect.shapes else p.null
            for p in one.effect.amplitudes
        ]
        result.append(Addition(one.effect, tuple(values), one.shape))
    return tuple(result)


def simple_base(problem: Problem) -> Problem:
    """The problem with neo-Hooke as its base, beside which alone effects are fitted."""
    top = max(base_functions.trained_top(part.system, part.train.rows) for part in problem.trained)
    cone = base_functions.base_cone(problem.basis, "positive", top, 1)
    return replace(problem, cone=cone, prior=problem.prior[:0])


def _misfit(problem: Problem, c: Array, additions: Additions, held: bool) -> Misfit:
    found = misfit(problem, c, additions, held)
    assert found is not None
    return found


def _shares(fit: Joint, widths: Widths) -> tuple[Share, ...]:
    found = [
        Share(
            a.effect,
            a.amplitudes,
            fit.deviations[a.effect.name],
            tuple(map(float, widths[a.effect.name])),
            a.shape,
            fit.costs[a.effect.name] / fit.dispersion,
            fit.r_squared[a.effect.name],
        )
        for a in fit.additions
    ]
    return tuple(sorted(found, key=lambda one: -one.rise))
