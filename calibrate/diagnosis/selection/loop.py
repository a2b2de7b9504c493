"""Close the loop: test the effects, add the best that data held out confirm, test the residual, until nothing is significant.

In: a `Problem` and its base fit. Out: `Discovery` with a round for each model, and a verdict.

An effect is added if its adjusted p-value is small, its amplitude is physically admissible, and the error on equations
that were not used for fitting falls. Once nothing more is added, each effect is taken out again and the others compete
for its place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis import residual_tests, score_tests, weighted_fit
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.misfit import misfit
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.selection import candidate_fit
from calibrate.diagnosis.selection.candidate_fit import Model, penalised
from calibrate.diagnosis.selection.confirmation import confirm
from calibrate.diagnosis.selection.exchange import review
from calibrate.diagnosis.selection.rounds import Candidate, Discovery, Refusal, RefusalReason, Review, Round
from calibrate.diagnosis.selection.thresholds import DEFAULT, Thresholds
from calibrate.diagnosis.selection.verdict import conclude, is_small
from calibrate.diagnosis.twin import with_own_twins
from calibrate.effects import CATALOGUE, Effect
from calibrate.fitting.resumable import SILENT, Resumable

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Reached:
    """Rounds that are over, the model of the next one (of the last, where that added nothing), and reviews of models with more than one effect, by their names."""

    rounds: tuple[Round, ...]
    model: Model
    reviews: dict[frozenset[str], Review] = field(default_factory=dict)
    is_last: bool = False


def close_loop(
    problem: Problem,
    state: Fit,
    effects: Sequence[Effect] = CATALOGUE,
    seed: int = 0,
    say: Resumable = SILENT,
    thresholds: Thresholds = DEFAULT,
    begun: tuple[Round, Model] | None = None,
) -> Discovery:
    """Rounds of tests and additions from a base fit, see `calibrate.diagnosis.discovery`. begun: the first round, already made, and the
    model to go on from."""
    base = Model(problem, state)
    stage = f"rounds from {' and '.join(begun[1].fit.names)}, of {len(effects)} effects" if begun else "rounds"
    reached: _Reached | None = say.load(stage)
    if reached is None:
        reached = _Reached((begun[0],), _finished(begun[1])) if begun else _Reached((), base)
    while not reached.is_last:
        reached = _with_round(reached, effects, seed, say, thresholds)
        say.save(stage, reached)
    model, names = reached.model, frozenset(reached.model.fit.names)
    confirmation = confirm(base, model, thresholds) if names else None
    review_of_last = reached.reviews.get(names, Review())
    return replace(conclude(model.problem, reached.rounds, review_of_last, thresholds, confirmation), start=problem)


def _with_round(
    reached: _Reached, effects: Sequence[Effect], seed: int, say: Resumable, thresholds: Thresholds
) -> _Reached:
    """One more round, and the model that it ends with."""
    rounds, model, reviews = reached.rounds, reached.model, reached.reviews
    say(f"round {len(rounds) + 1}: testing effects")
    now = scored_round(model, effects, seed, thresholds)
    added, names = None, frozenset(model.fit.names)
    if len(names) > 1 and names not in reviews:
        now, of_model, added = review(model, now, effects, thresholds, seed, say)
        reviews = {**reviews, names: of_model}
    enough = len(names) >= thresholds.most_named and is_small((*rounds, now)[0], now, thresholds)
    if added is None and len(names) < thresholds.most_effects and not enough:
        now, added = extended(model, now, say, thresholds)
    rounds = (*rounds, replace(now, candidates=tuple(one.decided for one in now.candidates)))
    return _Reached(rounds, model if added is None else _finished(added), reviews, added is None)


def scored_round(model: Model, effects: Sequence[Effect], seed: int = 0, thresholds: Thresholds = DEFAULT) -> Round:
    """Test every effect."""
    problem, state = model.problem, model.fit
    scores = score_tests.score(problem, state, effects, seed)
    tested = [s for s in scores if s.is_tested]
    like = score_tests.likeness(tested) if tested else np.zeros((0, 0))
    candidates = []
    for i, one in enumerate(scores):
        order = np.argsort(-like[i]) if one.is_tested else ()
        near = ((tested[j].effect.name, float(like[i, j])) for j in order if j != i)
        candidates.append(Candidate(one, like=tuple((n, v) for n, v in near if v > thresholds.similar)))
    train = misfit(problem, state.c, state.additions, False)
    assert train is not None
    held = misfit(problem, state.c, state.additions, True)
    predicted = residual_tests.prediction_test(problem, state.c, state.additions)
    misfits = residual_tests.misfits(problem, state.residual, state.columns)
    return Round(state, train, held, misfits, tuple(candidates), predicted)


def extended(model: Model, now: Round, say: Resumable, thresholds: Thresholds = DEFAULT) -> tuple[Round, Model | None]:
    """Add the best effect that is significant, admissible and confirmed by what was held out."""
    now, significant = _refined(model, now, thresholds)
    refusals: list[Refusal] = []
    confirmed: list[Candidate] = []
    fitted: dict[str, Candidate] = {}
    for candidate in significant:
        if not candidate.score.admissible:
            refusals.append(Refusal(candidate.name, RefusalReason.INADMISSIBLE))
            continue
        behind = confirmed and candidate.score.score < thresholds.rival * confirmed[0].score.score
        if len(fitted) == thresholds.tries or behind:
            break
        say(f"adding {candidate.name}")
        best = candidate_fit.fitted(model, replace(candidate, fit=None), thresholds)
        fitted[candidate.name] = best
        reason = candidate_fit.objection(model, now, best, thresholds)
        if reason:
            refusals.append(Refusal(candidate.name, reason))
        else:
            confirmed.append(best)
    candidates = tuple(fitted.get(candidate.name, candidate) for candidate in now.candidates)
    now = replace(now, candidates=candidates, refusals=tuple(refusals))
    return _with_best(now, confirmed, significant, thresholds) if confirmed else (now, None)


def _refined(model: Model, now: Round, thresholds: Thresholds) -> tuple[Round, list[Candidate]]:
    """The round with similarities at the best shapes, and its significant candidates, the best first."""
    significant = [c for c in now.candidates if c.is_significant(thresholds)]
    of_effect = {c.name: c for c in significant}
    scores = candidate_fit.at_best_shapes(model, [c.score for c in significant], thresholds)
    significant = [replace(of_effect[one.effect.name], score=one) for one in scores]
    likes = candidate_fit.similarities(significant, thresholds)
    significant = [replace(c, like=likes[c.name]) for c in significant]
    return replace(
        now, candidates=tuple(replace(c, like=likes.get(c.name, c.like)) for c in now.candidates)
    ), significant


def _with_best(
    now: Round, confirmed: Sequence[Candidate], significant: Sequence[Candidate], thresholds: Thresholds
) -> tuple[Round, Model]:
    """The round with the best of the confirmed effects and those that these data cannot tell from it."""

    left = penalised(now.fit, 0, confirmed)[1:]
    best = confirmed[int(np.argmin(left))]
    limit = left.min() + thresholds.equal_scores
    equal = [c.name for c, own in zip(confirmed, left, strict=True) if c is not best and own < limit]
    group = dict.fromkeys((best.name, *candidate_fit.alike(best, significant, thresholds), *equal))
    return replace(now, added=best.name, group=tuple(group)), candidate_fit.model(best)


def _finished(model: Model) -> Model:
    """The fit without effects that a later one has made superfluous, less the discretisation error of its own replay."""
    return Model(*with_own_twins(*weighted_fit.without_superfluous(model.problem, model.fit)))
