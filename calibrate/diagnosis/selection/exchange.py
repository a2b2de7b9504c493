"""Review of a model with several effects: each is taken out in turn, and all others compete for its place.

In: a model and its `Round`. Out: `Review`, and a model with another effect in the place of one, if that is better.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from calibrate.diagnosis import score_tests, weighted_fit
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.score_tests import Score
from calibrate.diagnosis.selection import candidate_fit
from calibrate.diagnosis.selection.candidate_fit import Model, penalised
from calibrate.diagnosis.selection.rounds import Candidate, Exchange, Review, Round
from calibrate.diagnosis.selection.thresholds import Thresholds
from calibrate.effects import Effect
from calibrate.effects.chain import Addition, Additions

GAIN = 1.0  # of the penalised deviance, that an exchange must bring


@dataclass(frozen=True, eq=False)
class _Place:
    """The place of one effect: the model with it and without, its number of amplitudes and shapes, and the fitted candidates for it."""

    whole: Fit
    without: Fit
    n_parameters: int
    candidates: list[Candidate]

    def gain(self, candidate: Candidate) -> float:
        """Of the penalised deviance, by a candidate in the place of the effect."""
        own, other = penalised(self.whole, self.n_parameters, [candidate])
        return float(own - other)


def review(
    model: Model, now: Round, effects: Sequence[Effect], thresholds: Thresholds, seed: int, say: Callable[[str], None]
) -> tuple[Round, Review, Model | None]:
    """Take each effect out and let all compete for its place; with another model if that is better."""
    state, best, exchange = model.fit, None, None
    gains: dict[str, float] = {}
    groups: dict[str, tuple[str, ...]] = {}
    most = GAIN
    for one in not_continued(state.additions):
        name = one.effect.name
        say(f"without {name}")
        place = _place(model, now, one, effects, thresholds, seed)
        gains[name] = place.without.free_loss - state.free_loss
        groups[name] = (name, *(c.name for c in place.candidates if place.gain(c) > -thresholds.equal_scores))
        for candidate in place.candidates:
            assert candidate.addition is not None
            gain = place.gain(candidate)
            if gain > most and is_sound(candidate, model.problem):
                most, best = gain, candidate_fit.model(candidate)
                exchange = Exchange(name, candidate.name)
    if exchange is None:
        return now, Review(gains, groups), None
    return replace(now, added=exchange.added, group=(exchange.added,), exchange=exchange), Review(gains, groups), best


def not_continued(additions: Additions) -> Additions:
    """Those that no other is more of, without which these would be none."""
    continued = {a.effect.beside.name for a in additions if a.effect.beside is not None}
    return tuple(a for a in additions if a.effect.name not in continued)


def is_sound(candidate: Candidate, problem: Problem) -> bool:
    """Whether a fitted effect is there and no simpler one under another name, and it and those beside it are possible and told by a test."""
    addition = candidate.addition
    assert candidate.fit is not None
    assert addition is not None
    additions = candidate.fit.additions
    possible = all(candidate_fit.is_possible(problem, a) and candidate_fit.is_told(problem, a) for a in additions)
    if not possible or candidate_fit.is_at_bounds(problem, additions):
        return False
    return not addition.effect.is_degenerate(addition.shape) and addition in candidate.fit.distinct


def _place(
    model: Model, now: Round, one: Addition, effects: Sequence[Effect], thresholds: Thresholds, seed: int
) -> _Place:
    """The model without one effect, and the effects that are fitted for its place."""
    state = model.fit
    others = tuple(a for a in state.additions if a is not one)
    weighted, without = weighted_fit.fit_with_weights(model.problem, state.c, others)
    scores = [s for s in score_tests.score(weighted, without, effects, seed) if s.is_tested]
    scores = candidate_fit.at_best_shapes(Model(weighted, without), scores, thresholds)
    own = next((s for s in scores if s.effect.name == one.effect.name), None)
    # the others as they were beside this one
    start = Model(model.problem, replace(state, additions=others, loss=without.loss, unexplained=without.unexplained))
    candidates = [
        candidate_fit.fitted(start, Candidate(s), thresholds) for s in _rivals(scores, own, one.effect.name, thresholds)
    ]
    kept = [c for c in candidates if c.fit is not None and not candidate_fit.grows(now, c.train, c.held, thresholds)]
    degrees = own.degrees if own else len(one.amplitudes)
    return _Place(state, without, degrees + len(one.shape), kept)


def _rivals(scores: Sequence[Score], own: Score | None, name: str, thresholds: Thresholds) -> list[Score]:
    """Significant, admissible scores nearly as high as that of the effect itself."""
    height = own.score if own else 0.0
    lowest = min(height - thresholds.equal_scores, thresholds.rival * height)
    likely = (s for s in scores if s.admissible and s.effect.name != name and s.adjusted < thresholds.significance)
    return [s for s in likely if s.score > lowest][: thresholds.tries]
