"""The dominant effect of a test that is not explained: what most of its misfit is traced to, though more than noise is left.

In: a `Discovery`. Out: `DominantEffect` or None. An effect whose true form is none of the catalogue's, or that has a small one beside it, is not explained; the one
effect that still takes nearly all of the misfit tells where to look. It is no explanation: something that acts like it may do the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.selection import candidate_fit
from calibrate.diagnosis.selection.candidate_fit import Model
from calibrate.diagnosis.selection.rounds import Candidate, Discovery, DominantEffect, Verdict

Say = Callable[[str], None]


def dominant_effect(found: Discovery, say: Say = lambda text: None) -> DominantEffect | None:
    """The effect that alone takes most of the misfit (`Thresholds.dominant_share`); None where none does, where the test is explained, or where its noise is unknown.

    The share is that of chi-square beyond its degrees of freedom, of all equations, each fit in its own weights.
    """
    if found.verdict is not Verdict.NOT_EXPLAINED or not found.problem.noise_is_known or not found.final.names:
        return None
    if found.base.unexplained.p_value >= found.thresholds.misfit_p:
        return None
    before = _excess(found.base)
    left = {name: _excess(fit) for name, fit in _alone(found, say)}
    if not left:
        return None
    best = min(left, key=lambda name: left[name])
    share = 1 - left[best] / before
    if share < found.thresholds.dominant_share:
        return None
    limit = found.thresholds.as_good * left[best]
    order = sorted(left, key=left.__getitem__)
    return DominantEffect(best, share, tuple(name for name in order if name != best and left[name] <= limit))


def _excess(fit: Fit) -> float:
    """Chi-square beyond what noise leaves, no less than one standard deviation of that."""
    return max(fit.free_loss - fit.degrees, (2 * max(fit.degrees, 1)) ** 0.5)


def _alone(found: Discovery, say: Say) -> Iterator[tuple[str, Fit]]:
    """Fits of one effect beside the base: of those of the final model, and of those with nearly the highest score, if nothing speaks against them."""
    assert found.start is not None
    base, first, thresholds = Model(found.start, found.base), found.rounds[0], found.thresholds
    known = found.rounds[1].fit if len(found.rounds) > 1 and len(found.rounds[1].fit.names) == 1 else None
    if known is not None and not candidate_fit.is_at_bounds(found.start, known.additions):
        yield known.names[0], known  # less the discretisation error of its own replay
    for candidate in _likely(found):
        if known is not None and candidate.name == known.names[0]:
            continue
        say(f"{candidate.name} alone")
        score = candidate_fit.at_best_shape(base, candidate.score)
        one = candidate_fit.fitted(base, replace(candidate, score=score, fit=None), thresholds)
        if one.fit is not None and candidate_fit.objection(base, first, one, thresholds) is None:
            yield one.name, one.fit


def _likely(found: Discovery) -> list[Candidate]:
    tested = [one for one in found.rounds[0].candidates if one.is_significant(found.thresholds)]
    highest = sorted(tested, key=lambda one: -one.score.score)[: found.thresholds.refined]
    near = {one.name for one in highest if one.score.score >= found.thresholds.rival * highest[0].score.score}
    return [one for one in tested if one.name in near or one.name in found.final.names]
