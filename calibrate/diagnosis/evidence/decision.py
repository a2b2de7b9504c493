"""The verdict in the light of all explanations.

In: the `Discovery` of the rounds, its `Weighing`. Out: the `Discovery` that both allow. The rule:

1. Where a fitted explanation is more than three times as probable as the final model of the rounds (positive evidence; Kass and Raftery 1995), they are run on from
   it, and what they end with takes the place of that model (where they put what is less probable in the place of an effect of the explanation, again without that); not where it explains the test no better and predicts what was held out worse, nor where
   the rounds explain the test and it does not.
2. An effect is named where the explanations with it, or with one of its group, have a probability above 95 % together, also where the rounds have it in an explanation and give it no name; two at most. Its group: effects
   that take its place in explanations of more than 5 %, and those in whose span alone it lies and that have more than 1 %.
3. Where that none is needed is three times as probable as all else together, and the residual of the base is no more than noise, or than noise that is somewhat larger than described, there is nothing: neither a candidate that is
   significant nor what the rounds have added without an explanation is an alarm.
4. Where an amplitude of the model is beyond three standard deviations of its prior by more than its error, it explains nothing: what nobody expects stands in for something else. Who does expect it says so in the table of priors.

That something in no catalogue is more probable changes no verdict: it is told beside it. Disturbances that are smooth over place and load are
also what is left of a strong effect by the errors of its formula and of the mesh, which the tests of the residual allow for.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from calibrate.diagnosis import weighted_fit
from calibrate.diagnosis.evidence.explanations import CERTAIN, TIE, Alternatives, Explanation, Finding, Weighing
from calibrate.diagnosis.evidence.power import powers
from calibrate.diagnosis.evidence.priors import FAR, Priors
from calibrate.diagnosis.evidence.signatures import prior_deviations
from calibrate.diagnosis.misfit import is_larger
from calibrate.diagnosis.selection.candidate_fit import Model, has_soft_base, is_at_bounds
from calibrate.diagnosis.selection.loop import close_loop
from calibrate.diagnosis.selection.rounds import Discovery, Doubt, Unexpected, Verdict
from calibrate.diagnosis.selection.verdict import is_larger_noise, is_noise
from calibrate.effects import Effect
from calibrate.errors import FitError
from calibrate.fitting.resumable import SILENT, Resumable
from calibrate.models.parameter_covariance import Z95

ODDS = 3.0  # to one, from which evidence is positive
REFUTED = 0.01  # probability below which an effect is told apart from one in whose place it could be
NONE = ODDS / (1 + ODDS)  # probability of no effect, from which it takes more than noise to say that there is something


def decided(
    found: Discovery,
    weighing: Weighing,
    priors: Priors,
    effects: Sequence[Effect],
    seed: int = 0,
    say: Resumable = SILENT,
) -> Discovery:
    """With the weighing; the verdict and the model changed by it where the explanations were fitted."""
    if weighing.fitted:
        other = _run_on(found, weighing.alternatives, effects, seed, say)
        if other is not None:
            shown = powers(other.problem, other.rounds[-1], found.thresholds.significance, priors)
            weighing = replace(weighing, powers=shown)
            found = replace(other, replaced=found.final.names)
        added, found = found.final.names, _judged(found, weighing)
        if found.final.names != added:
            shown = powers(found.problem, found.rounds[-1], found.thresholds.significance, priors)
            weighing = replace(weighing, powers=shown)
    else:
        found = replace(found, groups=_without_excluded(found.groups, weighing))
    return replace(_believed(found, priors), weighing=weighing)


def _without_excluded(groups: Mapping[str, tuple[str, ...]], weighing: Weighing) -> dict[str, tuple[str, ...]]:
    """Of the rounds, less what the test excludes beside the final model: that it tells apart."""
    excluded = {one.effect.name for one in weighing.powers if one.finding is Finding.EXCLUDED}
    return {
        name: tuple(other for other in group if other == name or other not in excluded)
        for name, group in groups.items()
    }


def _run_on(
    found: Discovery, alternatives: Alternatives, effects: Sequence[Effect], seed: int, say: Resumable
) -> Discovery | None:
    """The rounds from the best explanation on, where it is more probable than the final model by `ODDS`; None where it is not, or has no fit."""
    best = _best_fitted(alternatives)
    if best is None or best.probability <= ODDS * _probability(alternatives, found.final.names):
        return None
    assert found.start is not None
    say(f"on from {' and '.join(best.names)}")
    try:
        model = Model(*weighted_fit.fit_with_own_weights(found.start, found.base.c, best.additions))
        if has_soft_base(model.fit, found.base, found.thresholds) or is_at_bounds(model.problem, model.fit.additions):
            return None
        scores = {c.name: c.score.score for c in found.rounds[0].candidates if c.score.is_tested}
        added = max(best.names, key=lambda name: scores.get(name, 0.0))
        begun = replace(found.rounds[0], added=added, group=(added,)), model
        other = close_loop(found.start, found.base, effects, seed, say, found.thresholds, begun)
        while left := _less_probable(other.final.names, best, alternatives):
            effects = [effect for effect in effects if effect.name not in left]
            other = close_loop(found.start, found.base, effects, seed, say, found.thresholds, begun)
    except FitError:
        return None
    return None if _predicts_worse(other, found) else other


def _less_probable(names: Sequence[str], best: Explanation, alternatives: Alternatives) -> set[str]:
    """What the rounds from the best explanation have put in the place of an effect of it, where that is less probable by `ODDS`: an exchange knows no prior."""
    new = set(names) - set(best.names)
    exchanged = bool(new) and not set(best.names) <= set(names)
    return new if exchanged and best.probability > ODDS * _probability(alternatives, names) else set()


def _predicts_worse(other: Discovery, found: Discovery) -> bool:
    """Whether a model that explains nothing, or no more than that of the rounds, has larger errors held out: its evidence is that of what was fitted."""
    before, after = found.rounds[-1].held, other.rounds[-1].held
    explained = [one.verdict is Verdict.EXPLAINED for one in (found, other)]
    if explained[0] != explained[1]:
        return explained[0]
    return before is not None and is_larger(before, after, found.thresholds.worse)


def _best_fitted(alternatives: Alternatives) -> Explanation | None:
    return next((one for one in alternatives.explanations if one.additions and not one.discrepancy), None)


def _probability(alternatives: Alternatives, names: Sequence[str]) -> float:
    """Of exactly these effects."""
    return sum(e.probability for e in alternatives.explanations if set(e.names) == set(names) and not e.discrepancy)


def _judged(found: Discovery, weighing: Weighing) -> Discovery:
    """Names, groups and verdict by the probabilities."""
    if found.verdict is not Verdict.EXPLAINED and _is_nothing(found, weighing):
        return _of_base(found)
    if not found.final.names:
        return found
    groups = {name: _group(name, found.final.names, weighing) for name in found.final.names}
    if found.verdict is not Verdict.EXPLAINED:
        return replace(found, groups=groups)
    certain = _certain(found, groups, weighing.alternatives)
    if certain:
        closest = tuple(name for name in found.final.names if name not in certain)
        return replace(found, named=certain, closest=closest, groups=groups)
    return replace(found, groups=groups).doubted(Doubt.NOT_NEEDED)


def _certain(found: Discovery, groups: Mapping[str, tuple[str, ...]], alternatives: Alternatives) -> tuple[str, ...]:
    """Effects to be named. What the rounds have in the model without a name, as it is small beside another, is certain in spite of the error of the other's formula, which the probabilities have in them;
    unless it is nested in the other, or there were more names than an explanation has."""
    final = found.final
    sure = [name for name in final.names if alternatives.together(groups[name]) > CERTAIN]
    named = tuple(name for name in found.named if name in sure)
    nested = {a.effect.name for a in final.additions if a.effect.nested_in in final.names}
    more = tuple(name for name in sure if name in named or name not in nested)
    return more if named and len(more) <= found.thresholds.most_named else named


def _believed(found: Discovery, priors: Priors) -> Discovery:
    """No explanation where an effect has an amplitude that nobody expects: it stands in for something else, or the prior is too narrow."""
    beyond = tuple(_unexpected(found, priors))
    return found.doubted(Doubt.BEYOND_PRIOR, beyond_prior=beyond) if beyond else found


def _unexpected(found: Discovery, priors: Priors) -> Iterator[Unexpected]:
    """The farthest amplitude of each effect, where 95 % of its errors leave it beyond `FAR` standard deviations of its prior, which is that of `powers` beside the final model."""
    for one, errors in zip(found.final.additions, found.final.deviations, strict=True):
        parameters = one.effect.amplitudes
        change = np.abs(np.subtract(one.amplitudes, [p.null for p in parameters]))
        expected = prior_deviations(found.problem, one.effect, priors)
        least = (change - Z95 * np.array(errors)) / (FAR * expected)
        i = int(np.argmax(least))
        if least[i] > 1:
            known = priors.get(one.effect.name)
            table = () if known is None else (known.std, known.of, float(least[i] * known.std))
            yield Unexpected(one.effect.name, parameters[i].name, float(change[i] / expected[i]), *table)


def _is_nothing(found: Discovery, weighing: Weighing) -> bool:
    """Whether no effect is needed beside a base whose residual is noise, if larger than described."""
    first, limits = found.rounds[0], found.thresholds
    quiet = is_noise(found.problem, first, limits) or is_larger_noise(first, limits)
    return quiet and _probability(weighing.alternatives, ()) > NONE


def _of_base(found: Discovery) -> Discovery:
    """Nothing significant: without what the rounds have added."""
    assert found.start is not None
    first, names = replace(found.rounds[0], added=None, group=(), exchange=None), found.final.names
    return replace(
        found, problem=found.start if names else found.problem, rounds=(first,), verdict=Verdict.NOTHING_SIGNIFICANT,
        named=(), closest=(), groups={}, confirmation=None, dominant=None, replaced=names or None,
    )  # fmt: skip


def _group(name: str, final: Sequence[str], weighing: Weighing) -> tuple[str, ...]:
    """The effect, then those that these data cannot tell from it."""
    others = (
        other
        for one in weighing.alternatives.explanations
        if one.probability > TIE and name not in one.names
        for other in one.names
        if other not in final
    )
    inclusion = weighing.alternatives.inclusion
    alone = (other for other in weighing.groups.get(name, ()) if " with " not in other and other not in final)
    return tuple(dict.fromkeys((name, *others, *(other for other in alone if inclusion.get(other, 0.0) > REFUTED))))
