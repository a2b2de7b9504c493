"""All explanations of a test weighed against each other, and what it shows of every effect.

In: a `Discovery`. Out: `Weighing`: alternatives with probabilities and the power of the test. The subsets of effects are ranked by
`linear_evidence` at the base; those that no smaller one explains as well are fitted without linearisation (`refinement`); a larger one costs as much more than
the smaller within it as in the linear evidence, and gains nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.evidence import signatures
from calibrate.diagnosis.evidence.explanations import Alternatives, Explanation, Weighing
from calibrate.diagnosis.evidence.linear_evidence import Evidence, Subset
from calibrate.diagnosis.evidence.power import powers
from calibrate.diagnosis.evidence.priors import Priors
from calibrate.diagnosis.evidence.refinement import alternatives
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.selection import candidate_fit
from calibrate.diagnosis.selection.rounds import Discovery, Round, Verdict
from calibrate.effects import CATALOGUE, Effect
from calibrate.effects.effect import distinct
from calibrate.fitting.resumable import SILENT, Resumable

Array = NDArray[np.float64]
SHAPED, FITTED, SHOWN = (
    4,
    4,
    200,
)  # effects whose shape is refined, subsets that are fitted, sets of names that are weighed
NEAR, STRONG = 12.0, 0.1  # log evidence behind the best, absolute and relative, within which a subset is fitted
SPANNED = 0.98  # R^2 of a signature on up to two others


def weigh(
    found: Discovery,
    priors: Priors,
    effects: Sequence[Effect] = CATALOGUE,
    fitted: bool = True,
    say: Resumable = SILENT,
) -> Weighing:
    """Of a finished diagnosis. fitted: without linearisation, a fit for each of the best subsets, where anything is significant."""
    assert found.start is not None
    say("evidence of all explanations")
    problem, first, effects = found.start, found.rounds[0], distinct(effects)
    linear = signatures.evidence(problem, first.fit, found.final.chains, effects, priors, _shapes(problem, first))
    final = frozenset(found.final.names)
    ranked = _ranked(linear, final)
    result = _linear(linear, ranked)
    significant = found.verdict is not Verdict.NOTHING_SIGNIFICANT
    fitted = fitted and significant
    if fitted:
        say("fits of the best explanations")
        result = _fitted(problem, first.fit, effects, linear, ranked, priors, final, say)
    spanned = next((one for one in ranked if linear.names(one) == final), ranked[0])
    shown = powers(found.problem, found.rounds[-1], found.thresholds.significance, priors)
    return Weighing(result, spanning(linear, spanned), shown, fitted, significant)


def _shapes(problem: Problem, first: Round) -> dict[str, tuple[float, ...]]:
    """Refined shapes of the best significant effects that have one."""
    model = candidate_fit.Model(problem, first.fit)
    scores = [c.score for c in first.candidates if c.score.is_tested and c.score.shape and c.score.effect.shapes_vary]
    best = [s for s in scores if s.adjusted < 0.05][:SHAPED]
    return {s.effect.name: candidate_fit.at_best_shape(model, s).shape for s in best}


def _ranked(linear: Evidence, final: frozenset[str]) -> list[Subset]:
    """The best sets of names, the best first, the final model among them."""
    ranked = linear.by_names(linear.best(), SHOWN)
    if any(linear.names(one) == final for one in ranked):
        return ranked
    own = linear.of_names(final)
    return ranked if own is None else sorted((*ranked, own), key=lambda one: -one.log_evidence)


def _explanation(linear: Evidence, one: Subset, log_evidence: float) -> Explanation:
    return Explanation(tuple(sorted(linear.names(one))), log_evidence)


def _linear(linear: Evidence, ranked: Sequence[Subset]) -> Alternatives:
    """Every subset as it is, and something else alone."""
    found = [_explanation(linear, one, one.log_evidence) for one in ranked]
    return Alternatives.of([*found, Explanation((), linear.discrepancy(), discrepancy=True)])


def _fitted(
    problem: Problem,
    base: Fit,
    effects: Sequence[Effect],
    linear: Evidence,
    ranked: Sequence[Subset],
    priors: Priors,
    final: frozenset[str],
    say: Resumable,
) -> Alternatives:
    """Minimal subsets fitted, larger ones beside them."""
    minimal = _minimal(linear, ranked)
    limit = ranked[0].log_evidence - max(NEAR, STRONG * abs(ranked[0].log_evidence))
    chosen = [one for one in minimal if one.log_evidence > limit][:FITTED]
    names = {linear.names(one) for one in chosen}
    chosen += [one for one in ranked if linear.names(one) == final and final not in names]
    fits = alternatives(problem, base, effects, linear, chosen, priors, say)
    level = {frozenset(one.names): one.log_evidence for one in fits.explanations if not one.discrepancy}
    linear_of = {linear.names(one): one for one in ranked}
    more = []
    for one in ranked:
        own = linear.names(one)
        inside = [parent for parent in level if parent < own and parent in linear_of and parent]
        if own not in level and inside:
            parent = max(inside, key=lambda p: level[p])
            more.append(_explanation(linear, one, level[parent] + cost(one, linear_of[parent])))
    return Alternatives.of([*fits.explanations, *more])


def cost(larger: Subset, smaller: Subset) -> float:
    """Log evidence that further effects cost: what they gain linearly may be what the smaller subset has gained by its fit."""
    return min(larger.charge - smaller.charge, 0.0)


def _minimal(linear: Evidence, ranked: Sequence[Subset]) -> list[Subset]:
    """Subsets, the best first, of which no smaller one has more evidence."""
    kept: list[Subset] = []
    for one in ranked:
        if not any(linear.names(other) < linear.names(one) for other in kept):
            kept.append(one)
    return kept


def spanning(linear: Evidence, best: Subset) -> dict[str, tuple[str, ...]]:
    """For every effect of the best subset those effects that it does not have, alone or with another, in whose span its change lies."""
    found = {}
    for i, a in zip(best.members, best.amplitudes, strict=True):
        own = linear.signatures[i]
        y, others = own.columns @ a, {linear.signatures[k].name for k in best.members if k != i}
        spans: dict[str, Array] = {}
        shares: dict[str, float] = {}
        for s in linear.signatures:
            instead = s.name not in (own.name, *others) and s.beside in ("", *others)
            share = _share(y, s.columns) if instead else 0.0
            if share > shares.get(s.name, 0.0):
                spans[s.name], shares[s.name] = s.columns, share
        alone = [name for name in spans if shares[name] > SPANNED]
        pairs = [
            f"{one} with {other}"
            for k, one in enumerate(spans)
            for other in list(spans)[k + 1 :]
            if one not in alone and other not in alone
            and _share(y, np.concatenate([spans[one], spans[other]], axis=1)) > SPANNED
        ]  # fmt: skip
        found[own.name] = (*alone, *pairs)
    return found


def _share(y: Array, S: Array) -> float:
    """R^2 of y (N,) on columns S (N, k)."""
    coefficients = np.linalg.lstsq(S, y, rcond=1e-9)[0]
    rest = y - S @ coefficients
    return 1 - float(rest @ rest) / max(float(y @ y), 1e-300)
