"""The verdict of a diagnosis from its rounds.

Effects are named only if the residual is noise, or a small part of what they explain, both where they were fitted and where they
were not, and if those that explain more than another may leave are not more than `most_named`: a catalogue that lacks the true
effect imitates it with several. Otherwise they are the closest of the catalogue, and the residual is not explained.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.residual_tests import ChiSquare
from calibrate.diagnosis.selection.rounds import Confirmation, Discovery, Review, Round, Verdict
from calibrate.diagnosis.selection.thresholds import DEFAULT, Thresholds
from calibrate.effects.chain import Additions

LARGER = 2.0  # variance of noise over what is described, up to which a residual may be noise of another kind


def conclude(
    problem: Problem,
    rounds: tuple[Round, ...],
    review: Review,
    thresholds: Thresholds = DEFAULT,
    confirmation: Confirmation | None = None,
) -> Discovery:
    """Verdict from the rounds, the review of the last model, and what speaks against it as an explanation."""
    first, last = rounds[0], rounds[-1]
    names = last.fit.names
    significant = any(candidate.is_significant(thresholds) for candidate in last.candidates)
    noise_alone = is_noise(problem, last, thresholds)
    if not names:
        quiet = noise_alone and not significant
        verdict = Verdict.NOTHING_SIGNIFICANT if quiet else Verdict.NOT_EXPLAINED
        return Discovery(problem, rounds, verdict, (), (), {}, thresholds)
    groups = {r.added: r.group for r in rounds if r.added in names}
    groups.update({name: group for name, group in review.groups.items() if name in names})
    clean = noise_alone and not significant
    gains = review.gains or dict.fromkeys(names, first.fit.free_loss - last.fit.free_loss)
    name_those = not_nested if clean else worth_a_name
    major = name_those(last.fit.additions, gains, thresholds)
    explained = 0 < len(major) <= thresholds.most_named and (clean or is_small(first, last, thresholds))
    explained = explained and not (confirmation and confirmation.doubts)
    named = major if explained else ()
    closest = tuple(n for n in names if n not in named)
    verdict = Verdict.EXPLAINED if explained else Verdict.NOT_EXPLAINED
    return Discovery(problem, rounds, verdict, named, closest, groups, thresholds, confirmation)


def is_noise(problem: Problem, now: Round, thresholds: Thresholds) -> bool:
    """Whether residual and prediction are no more than noise; where the noise is unknown they are taken to be."""
    return not problem.noise_is_known or (
        now.misfits.p_value > thresholds.misfit_p and now.predicted_p > thresholds.misfit_p
    )


def is_larger_noise(now: Round, thresholds: Thresholds) -> bool:
    """Whether residual and prediction would be no more than noise if its variance were larger than described, by no more than `LARGER`: nothing in them is smooth over place and load, and what was held out is missed no
    more than what was fitted. The variance is that of where no discretisation error could be, if it is larger there."""
    share = max(one.value / max(one.degrees, 1) for one in (now.misfits.everything, now.misfits.certain))
    if not share <= LARGER:
        return False
    tests = [now.misfits.smooth, *([] if now.predicted is None else [now.predicted])]
    return all(ChiSquare(one.value / max(share, 1.0), one.degrees).p_value > thresholds.misfit_p for one in tests)


def worth_a_name(additions: Additions, gains: Mapping[str, float], thresholds: Thresholds = DEFAULT) -> tuple[str, ...]:
    """Effects that explain more than any other may leave. gains: rise of the misfit without each, where it was found."""
    shares = (thresholds.secondary_share, thresholds.secondary_share_truncated)
    left = max(shares[a.effect.truncated] * gains.get(a.effect.name, 0.0) for a in additions)
    return tuple(a.effect.name for a in additions if gains.get(a.effect.name, np.inf) >= left)


def not_nested(additions: Additions, gains: Mapping[str, float], thresholds: Thresholds = DEFAULT) -> tuple[str, ...]:
    """Effects but those that explain no more than the series that they are nested in may leave for others, as an inclusion what a stiffness field leaves of
    a patch. gains: see `worth_a_name`."""
    left = {
        a.effect.name: thresholds.secondary_share_truncated * gains.get(a.effect.name, 0.0)
        for a in additions
        if a.effect.truncated
    }
    return tuple(
        a.effect.name for a in additions if gains.get(a.effect.name, np.inf) >= left.get(a.effect.nested_in, 0.0)
    )


def is_small(first: Round, last: Round, thresholds: Thresholds = DEFAULT) -> bool:
    """Whether the residual, fitted and held out, is a small part of what was explained.

    Each test of the residual is compared with the largest fall of any of them: some see little of an effect and yet all of what
    its formula leaves.
    """
    before, after = (_tests(first), _tests(last))
    explained = max(b.value - a.value for b, a in zip(before, after, strict=True))
    allowed = thresholds.residual_share * max(explained, 0.0)
    return all(a.value - a.degrees <= allowed or a.p_value >= thresholds.misfit_p for a in after)


def _tests(now: Round) -> list[ChiSquare]:
    return [test for test in (*now.misfits, now.predicted) if test is not None]
