"""What a test shows of every effect: found, excluded above an amplitude, or invisible in it.

In: the last round of a diagnosis, priors. Out: `Power` of every effect. The limit of an effect that is not in the model is the upper 95 %
bound of its amplitude beside the final model: one-sided where it cannot be below null (in the manner of upper limits in counting
experiments; Cowan 2011), of the largest where it has several. It is invisible where that bound is wider than the prior: the
test then says no more than was believed before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import special

from calibrate.diagnosis.evidence.explanations import Finding, Power
from calibrate.diagnosis.evidence.priors import Priors
from calibrate.diagnosis.evidence.signatures import prior_deviations
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.score_tests import Status
from calibrate.diagnosis.selection.rounds import Candidate, Round
from calibrate.effects.chain import Addition

Array = NDArray[np.float64]
CONFIDENCE = 0.95


def powers(problem: Problem, last: Round, significance: float, priors: Priors) -> tuple[Power, ...]:
    """Of the effects of the final model, then of every candidate of its round."""
    fitted = zip(last.fit.additions, last.fit.deviations, strict=True)
    found = tuple(_largest(a, np.array(errors), prior_deviations(problem, a.effect, priors)) for a, errors in fitted)
    return (*found, *(_of_candidate(problem, one, significance, priors) for one in last.candidates))


def _largest(found: Addition, deviations: Array, prior: Array) -> Power:
    """Of an effect in the model: of several amplitudes the one that stands out most. prior (p,): standard deviations before the test."""
    values = np.array(found.amplitudes)
    null = np.array([p.null for p in found.effect.amplitudes])
    i = int(np.argmax(np.abs(values - null) / deviations))
    value = float(values[i]), float(deviations[i])
    return Power(found.effect, Finding.FOUND, found.effect.amplitudes[i], value, None, float(prior[i]))


def _of_candidate(problem: Problem, one: Candidate, significance: float, priors: Priors) -> Power:
    score, effect = one.score, one.score.effect
    if score.status is Status.EXCLUDED:
        return Power(effect, Finding.MEASURED, effect.amplitudes[0])
    prior = prior_deviations(problem, effect, priors)
    if any(own.effect.name == effect.name for part in problem.trained for own in part.own):
        return Power(effect, Finding.OWN, effect.amplitudes[0], None, None, float(prior[0]))
    if not score.is_tested:
        return Power(effect, Finding.INVISIBLE, effect.amplitudes[0], None, None, float(prior[0]), score.missing)
    limits = [
        upper_limit(value - p.null, deviation, p.lower == p.null)
        for value, deviation, p in zip(score.amplitudes, score.errors, effect.amplitudes, strict=True)
    ]
    worst = int(np.argmax(np.array(limits) / prior))
    seen = score.adjusted < significance and score.admissible
    finding = Finding.OPEN if seen else Finding.EXCLUDED if limits[worst] <= prior[worst] else Finding.INVISIBLE
    return Power(effect, finding, effect.amplitudes[worst], None, limits[worst], float(prior[worst]))


def upper_limit(estimate: float, deviation: float, one_sided: bool) -> float:
    """Largest distance from null at 95 %. One-sided: an estimate below null counts as null."""
    if one_sided:
        return float(max(estimate, 0.0) + special.ndtri(CONFIDENCE) * deviation)
    return float(abs(estimate) + special.ndtri(0.5 + 0.5 * CONFIDENCE) * deviation)
