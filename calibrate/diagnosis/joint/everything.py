"""All effects at once, each as strong as its prior allows, for tests that no few effects explain.

In: a `Problem`, effects, priors. Out: `Everything`. Beside neo-Hooke, so that no flexible base hides an effect; the upturn and the second
invariant, with their priors, make it Yeoh's or Mooney and Rivlin's. What none of them explains is a smooth discrepancy (`discrepancy`). Its variance is that of what neo-Hooke leaves: updated with the fit it would grow without
end, as what is not seen may be fitted badly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.diagnosis import base_functions, effect_fit, score_tests
from calibrate.diagnosis import problem as equations
from calibrate.diagnosis.evidence.priors import Priors
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
from calibrate.equations.basis import energy_basis

Array = NDArray[np.float64]
Say = Callable[[str], None]
NESTED = {"one fibre family": "two fibre families", "stiffness gradient": "stiffness field"}  # in the more general one
SMOOTH = {
    "initial warp"
}  # left out: ten smooth amplitudes without a law are a second discrepancy, and neither can be told from the other
MOST = 60  # increments of a test with a memory: derivatives of several histories at once take memory that grows faster than they do
FIRST, STEPS = 5, 30  # steps from every start, and from the best


def fit_everything(
    problem: Problem, effects: Sequence[Effect], priors: Priors, say: Say = lambda text: None
) -> Everything:
    """Of the training rows of a problem, with its weights. Raises `FitError` where a fit has no finite start, nothing can be tested, or a test has too
    many increments."""
    problem = simple_base(problem)
    effects = [effect for effect in effects if effect.name not in SMOOTH]
    base = effect_fit.refit(problem, base_functions.first_guess([part.assembled for part in problem.trained]), ())
    scores = [score for score in score_tests.score(problem, base, effects) if score.is_tested]
    names = {score.effect.name for score in scores}
    additions = candidates(scores, [name for name, general in NESTED.items() if general in names])
    if not additions:
        raise errors.FitError("no effect of the catalogue can be tested with these data, so that none can be fitted")
    longest = max(part.experiment.n_increments for part in problem.parts)
    if longest > MOST and any(a.effect.remembers for a in additions):
        raise errors.FitError(
            f"{longest} increments need more memory than a computer may have where effects have a history; give at most {MOST}"
        )
    widths = {a.effect.name: prior_deviations(problem, a.effect, priors) for a in additions}
    D = discrepancy.directions(problem)
    variance = discrepancy.variance_of(base.residual, D)
    fit = _best_start(problem, base.c, additions, widths, D, variance, say)
    say(f"all {len(additions)} effects at once, to the end")
    with_it = discrepancy.with_discrepancy(problem, D, variance)
    fit = joint_fit.fit(with_it, fit.c, fit.additions, widths, STEPS)
    left = discrepancy.variance_of(equations.residual(problem, fit.c, fit.additions), D)
    before_it, after_it = (
        (_misfit(problem, c, some, held=False), misfit(problem, c, some, held=True))
        for c, some in ((base.c, ()), (fit.c, fit.additions))
    )
    return Everything(fit, _shares(fit, widths), before_it, after_it, left, fit.dispersion)


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
    start = base_functions.first_guess([part.assembled for part in problem.trained])
    bulk = problem.basis.n_functions - energy_basis(problem.basis).n_functions
    prior = base_functions.smoothness("positive", 1, bulk) / (base_functions.STIFFENING * float(start.max()))
    cone = base_functions.base_cone(problem.basis, "positive", top, 1)
    return replace(problem, cone=cone, prior=prior, parametric=True)


def _best_start(
    problem: Problem, c: Array, additions: Additions, widths: Widths, D: Array, variance: float, say: Say
) -> Joint:
    """A few steps from the shapes of the score tests, and from the shortest of the times that the material remembers: relaxation that is fast
    beside the increments looks like an offset of force or time to a score."""
    with_it = discrepancy.with_discrepancy(problem, D, variance)
    starts = [additions]
    if any(a.effect.remembers and a.shape for a in additions):
        data = problem.trained[0].chain.data
        starts.append(
            tuple(
                replace(a, shape=a.effect.shape_values(data)[0]) if a.effect.remembers and a.shape else a
                for a in additions
            )
        )
    found = []
    for i, start in enumerate(starts):
        say(f"all {len(additions)} effects at once, start {i + 1} of {len(starts)}")
        found.append(joint_fit.fit(with_it, c, start, widths, FIRST))
    return min(found, key=lambda one: one.objective)


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
            fit.imitated[a.effect.name],
        )
        for a in fit.additions
    ]
    return tuple(sorted(found, key=lambda one: -one.rise))
