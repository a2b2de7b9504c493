"""Candidates of a round fitted to be compared: best shape, refit, penalised misfit, refusal.

In: the `Problem`, the fit of a round, a `Candidate`. Out: the candidate with its fit, or the reason why it is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from calibrate import errors
from calibrate.diagnosis import effect_fit, score_tests, weighted_fit
from calibrate.diagnosis import problem as equations
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.misfit import AMPLIFIED, Misfit, amplification, deviances, is_better, is_larger, misfit
from calibrate.diagnosis.parameters import at_bounds
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.score_tests import Score, likeness
from calibrate.diagnosis.selection.rounds import Candidate, RefusalReason, Round
from calibrate.diagnosis.selection.thresholds import Thresholds
from calibrate.effects.chain import Addition, Additions

Array = NDArray[np.float64]
RIVAL = 0.8  # share of the best score, from which another shape is fitted, too
SAME = 0.999  # cosine of changes, above which two shapes make one: they may be alike, and a fit end elsewhere from each
FIRST_STEP = 0.13  # of a shape, over its size
LEAST_EVALUATIONS, EVALUATIONS = 14, 5  # of shapes: in all, and for each and one more; the fit goes on from there


@dataclass(frozen=True, eq=False)
class Model:
    """A fit with the weights that belong to it."""

    problem: Problem
    fit: Fit


def model(candidate: Candidate) -> Model:
    """The fit of a candidate that was made to be compared."""
    assert candidate.problem is not None and candidate.fit is not None
    return Model(candidate.problem, candidate.fit)


def fitted(now: Model, candidate: Candidate, thresholds: Thresholds) -> Candidate:
    """The candidate with a refit of base and effect and its errors.

    It has the weights that belong to it: those of a base that makes up for the effect are wrong. It starts from the best shape and from the
    others (`Score.others`); the most likely of all is taken, of those inside what is possible if any is: what the data hardly tell may run to the end of it from one start and not from another.
    Without a fit where none is better than the model without the effect, or where it runs away: it then did not converge.
    """
    state, score = now.fit, candidate.score
    starts = [score, *(score.others if candidate.is_significant(thresholds) else ())]
    found = [_fit(now, replace(candidate, score=one), thresholds) for one in starts]
    limit = thresholds.worse * state.free_loss + len(score.amplitudes)
    kept = [pair for pair in found if pair is not None and pair[1].free_loss < limit]
    if not kept:
        return candidate
    left = deviances([state, *(fit for _, fit in kept)])[1:]
    beyond = np.array([is_at_bounds(own, fit.additions) for own, fit in kept])
    problem, new = kept[np.lexsort((left, beyond))[0]]
    train, held = (misfit(problem, new.c, new.additions, other) for other in (False, True))
    if not all(np.isfinite(one.chi_square) for one in (train, held) if one is not None):
        return candidate
    return replace(candidate, fit=new, problem=problem, train=train, held=held)


def _fit(now: Model, candidate: Candidate, thresholds: Thresholds) -> tuple[Problem, Fit] | None:
    """With the weights that a fit of its kind has; None where it runs away."""
    problem, state = now.problem, now.fit
    additions = (*state.additions, _start(now, candidate.score, thresholds))
    try:
        if not candidate.is_significant(thresholds):
            return problem, effect_fit.refit(problem, state.c, additions)
        return weighted_fit.fit_with_own_weights(problem, state.c, additions)
    except errors.FitError:
        return None


def _start(now: Model, found: Score, thresholds: Thresholds) -> Addition:
    """The effect as the score test estimates it; at its null value where that is far outside of what the test is good for."""
    addition = Addition(found.effect, found.amplitudes, found.shape)
    loss = equations.loss(now.problem, now.fit.c, (*now.fit.additions, addition))
    if loss < thresholds.worse * now.fit.loss + now.fit.n_rows:
        return addition
    return replace(addition, amplitudes=tuple(p.null for p in found.effect.amplitudes))


def objection(model: Model, now: Round, candidate: Candidate, thresholds: Thresholds) -> RefusalReason | None:
    """Why a fitted effect is not added to the model of a round; None where nothing speaks against it.

    The misfit that amplitudes are found and compared by lets the base have any energy, a negative one too; the errors here
    are those of a base that may be one.
    """
    if candidate.fit is None or candidate.addition is None or candidate.train is None:
        return RefusalReason.NO_BETTER_FIT
    if candidate.addition not in candidate.fit.distinct:
        return RefusalReason.NULL_AMPLITUDE
    if is_at_bounds(model.problem, candidate.fit.additions):
        return RefusalReason.INADMISSIBLE
    if not all(is_possible(model.problem, one) for one in candidate.fit.additions):
        return RefusalReason.IMPOSSIBLE
    if not all(is_told(model.problem, one) for one in candidate.fit.additions):
        return RefusalReason.UNTOLD
    if candidate.addition.effect.is_degenerate(candidate.addition.shape):
        return RefusalReason.DEGENERATE
    if has_soft_base(candidate.fit, now.fit, thresholds):
        return RefusalReason.SOFT_BASE
    if grows(now, candidate.train, candidate.held, thresholds):
        return RefusalReason.LARGER_ERRORS
    if now.held is not None and candidate.held is not None and not is_better(now.held, candidate.held):
        return RefusalReason.HELD_OUT_NOT_BETTER
    if not is_better(now.train, candidate.train):
        return RefusalReason.NO_ERROR_FALLS
    assert candidate.problem is not None
    both = Model(candidate.problem, candidate.fit)
    return None if falls_in_either_weights(model, both) else RefusalReason.LARGER_IN_OTHER_WEIGHTS


def is_at_bounds(problem: Problem, additions: Additions) -> bool:
    """Whether an effect would go beyond what a specimen or a rig may have, see `parameters.at_bounds`."""
    return any(at_bounds(one, problem.tests) for one in additions)


def is_possible(problem: Problem, one: Addition) -> bool:
    """In every test that was fitted."""
    return all(one.effect.is_possible(data, one.amplitudes, one.shape) for data in problem.tests)


def is_told(problem: Problem, one: Addition) -> bool:
    """By one of the tests that were fitted."""
    return any(one.effect.is_told(data, one.shape) for data in problem.tests)


def has_soft_base(fit: Fit, base: Fit, thresholds: Thresholds) -> bool:
    """Whether effects take the place of the material, and leave a base with hardly any stiffness."""
    return bool(np.linalg.norm(fit.c) < thresholds.softest_base * np.linalg.norm(base.c))


def falls_in_either_weights(before: Model, after: Model) -> bool:
    """Whether chi-square of the equations held out (fitted, where none are) falls with the weights of one model and of the other, but for the noise that the second adds, up to `AMPLIFIED` times that of the first.

    With its own weights alone a model may call its errors small that makes the noise in its forces large.
    """
    held = any(part.held.size for part in before.problem.parts)
    (old, new), (old_by_other, new_by_own) = (
        [_misfit(weights.problem, one, held) for one in (before, after)] for weights in (before, after)
    )
    r = max(amplification(old, new_by_own), 1.0)
    added = min(r, AMPLIFIED) - 1
    return new.chi_square < old.chi_square + added and new_by_own.chi_square < old_by_other.chi_square + added / r


def _misfit(weights: Problem, one: Model, held: bool) -> Misfit:
    """Of a model in the weights of another."""
    found = misfit(weights, one.fit.c, one.fit.additions, held)
    assert found is not None
    return found


def grows(now: Round, train: Misfit | None, held: Misfit | None, thresholds: Thresholds) -> bool:
    """Whether a model has larger errors than that of a round, where they were fitted or where they were not."""
    worse = thresholds.worse
    return is_larger(now.train, train, worse) or (now.held is not None and is_larger(now.held, held, worse))


def penalised(base: Fit, n_parameters: int, candidates: Sequence[Candidate]) -> Array:
    """Deviances (1 + m,) of a fit and of those of candidates, with the penalty on amplitudes and shapes (BIC; Schwarz 1978), of which the first has so many more than those that all have."""
    fits, numbers = [base], [n_parameters]
    for one in candidates:
        assert one.fit is not None
        fits.append(one.fit)
        numbers.append(one.score.degrees + len(one.score.shape))
    return np.asarray(deviances(fits) + np.log(base.n_rows) * np.array(numbers))


def similarities(candidates: Sequence[Candidate], thresholds: Thresholds) -> dict[str, tuple[tuple[str, float], ...]]:
    """Cosines between effects at their best shapes, where these are more alike than at those of the grid.

    Two families of fibres that close up are one, which no shape of the grid shows.
    """
    cosines = score_tests.likeness([c.score for c in candidates]) if candidates else np.zeros((0, 0))
    result = {}
    for candidate, line in zip(candidates, cosines, strict=True):
        like = dict(candidate.like)
        for other, cosine in zip(candidates, line, strict=True):
            if other is not candidate and cosine > max(like.get(other.name, 0.0), thresholds.similar):
                like[other.name] = float(cosine)
        result[candidate.name] = tuple(sorted(like.items(), key=lambda pair: -pair[1]))
    return result


def alike(candidate: Candidate, significant: Sequence[Candidate], thresholds: Thresholds) -> list[str]:
    """Significant effects that the data cannot tell from one: signatures alike, or scores nearly as high."""
    cosines = dict(candidate.like)
    lowest = candidate.score.score - thresholds.equal_scores
    return [
        other.name
        for other in significant
        if other is not candidate
        and other.score.admissible
        and (cosines.get(other.name, 0.0) > thresholds.collinear or other.score.score > lowest)
    ]


def at_best_shape(now: Model, found: Score) -> Score:
    """The score at the best shape near the best one of the grid or near one of the others, by a few steps of Nelder and Mead's simplex from each. Its others: what the rest have ended with that is
    another change and nearly as good."""
    if not found.shape or not found.effect.shapes_vary:
        return found
    search = _ShapeSearch(replace(now, fit=now.fit.remembering()), found)
    ends = [search.near(start) for start in (found, *found.others)]
    best, *rest = sorted(ends, key=lambda one: (one.admissible, one.score), reverse=True)
    others = [one for one in rest if one.score > RIVAL * best.score and likeness([one, best])[0, 1] < SAME]
    return replace(best, others=tuple(one for one in others if one.admissible))


def at_best_shapes(now: Model, scores: Sequence[Score], thresholds: Thresholds) -> list[Score]:
    """Scores, the best first, of the first `Thresholds.refined` that have a shape at their best one: what has none may score higher before."""
    shaped = [one for one in scores if one.shape and one.effect.shapes_vary][: thresholds.refined]
    found = [at_best_shape(now, one) if one in shaped else one for one in scores]
    return sorted(found, key=lambda one: -one.evidence)


class _ShapeSearch:
    """Minus the score of an effect as a function of its shape; remembers the best score found.

    The score of the search is over the dispersion; others are scaled like the first, which is at the same shape.
    """

    def __init__(self, now: Model, found: Score) -> None:
        self.now, self.found, self.best = now, found, found
        self.first = 0.0
        U = now.fit.columns
        self.residual = now.fit.residual - U @ (U.T @ now.fit.residual)
        grid = np.array(now.problem.shapes(found.effect))
        self.logarithmic = np.array(
            [p.lower >= 0 and np.all(grid[:, i] > 0) for i, p in enumerate(found.effect.shapes)]
        )

    def near(self, start: Score) -> Score:
        """The best score near that of a shape; of the first one that is given `found`."""
        if self.first:
            self.best = replace(start, score=0.0)
        parameters = self.found.effect.shapes
        x = np.where(self.logarithmic, np.log(np.maximum(start.shape, 1e-12)), start.shape)
        sizes = [p.shape_size(v) for p, v in zip(parameters, start.shape, strict=True)]
        simplex = np.concatenate([x[None], x + np.diag(np.where(self.logarithmic, 0.5, FIRST_STEP * np.array(sizes)))])
        options = {
            "maxfev": max(LEAST_EVALUATIONS, EVALUATIONS * (len(x) + 1)), "initial_simplex": simplex, "xatol": 1e-3, "fatol": 1e-2
        }  # fmt: skip
        minimize(self, x, method="Nelder-Mead", options=options)
        return self.best

    def __call__(self, values: Array) -> float:
        found = self.found
        shape = tuple(float(v) for v in np.where(self.logarithmic, np.exp(values), values))
        if any(not p.lower <= v <= p.upper for p, v in zip(found.effect.shapes, shape, strict=True)):
            return 0.0
        null = tuple(p.null for p in found.effect.amplitudes)
        addition = Addition(found.effect, null, shape)
        one, _ = score_tests.examine_shape(
            self.now.problem, self.now.fit, addition, self.now.fit.columns, self.residual
        )
        self.first = self.first or max(one.score, 1e-300)
        value = found.score * one.score / self.first
        if one.is_tested and one.admissible >= self.best.admissible and value > self.best.score:
            self.best = replace(one, score=value, p_value=found.p_value, adjusted=found.adjusted)
        return -one.score
