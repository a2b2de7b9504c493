"""The best subsets fitted without linearisation, and their probabilities.

In: the base, subsets ranked by `linear_evidence`. Out: `Alternatives`. Each subset is fitted with the weights that belong to it, and its
evidence is Laplace's approximation there, see `calibrate.diagnosis.evidence.formula_error`, with the variance of residuals by `misfit.residual_variances`. The noise there is what its effects make of that of the displacements: the base of each is as stiff as it is,
or a softer one would win.

A fit of several effects is evidence for its parts, too: what a part lacks may be an error of its formulas that looks like it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy import special

from calibrate import errors
from calibrate.diagnosis import effect_fit, model_weights, weighted_fit
from calibrate.diagnosis import problem as equations
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.evidence.explanations import Alternatives, Explanation
from calibrate.diagnosis.evidence.formula_error import FittedEffect, SecondOrder
from calibrate.diagnosis.evidence.linear_evidence import Evidence, Subset, over_variances
from calibrate.diagnosis.evidence.priors import Priors
from calibrate.diagnosis.evidence.signatures import base_span, disturbances, prior_deviations
from calibrate.diagnosis.misfit import residual_variances
from calibrate.diagnosis.parameters import Variables
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.selection.candidate_fit import has_soft_base, is_at_bounds, is_possible, is_told
from calibrate.diagnosis.selection.thresholds import DEFAULT
from calibrate.effects import Effect
from calibrate.effects.chain import Addition, Additions, Chain
from calibrate.fitting.least_squares import bounded
from calibrate.fitting.resumable import SILENT, Resumable

Array = NDArray[np.float64]
START, TIMES = (
    0.5,
    4,
)  # share of the linear estimate that a fit starts from where the whole has a larger misfit, taken so often
STAGE = "explanation"
NEAR, PARTS = (
    3.0,
    3,
)  # log evidence behind the best, within which a part of a set is fitted: one of 5 %; so many at most
WORSE = 2.0  # times the misfit of the base: the fit ran away


@dataclass(frozen=True, eq=False)
class _Refit:
    """A subset fitted, and that fit to second order. amplified: variance of the noise that its effects make, over that of the effects of the best fit."""

    fit: Fit
    weighed: SecondOrder
    amplified: float


@dataclass(frozen=True, eq=False)
class _Fits:
    """The best fit of every set of effects, but of none, and the equations with the weights of the best of all. tried: sets that fits were started from."""

    weights: Problem
    found: Mapping[frozenset[str], Fit] = field(default_factory=dict)
    tried: frozenset[frozenset[str]] = frozenset()


def alternatives(
    problem: Problem, base: Fit, effects: Sequence[Effect], linear: Evidence, subsets: Sequence[Subset], priors: Priors,
    say: Resumable = SILENT,
) -> Alternatives:  # fmt: skip
    """Fits of the subsets and of none, each with and without a discrepancy, and their probabilities. Fits that run away are left out, effects
    that a fit leaves at none as well: it is that of the smaller subset. Parts of these sets are fitted, too, where what they lack may be an error of their formulas."""
    known = {effect.name: effect for effect in effects}
    shares = {s.name: s.prior for s in linear.signatures}
    chosen = [_additions(problem, linear, one, known, priors) for one in subsets if one.members]
    fits: _Fits = _best_of_each(say.load(STAGE) or _Fits(problem), problem, base, chosen, known, say)
    best = min(fits.found.values(), key=lambda fit: fit.free_loss, default=base)
    again = partial(_refitted, fits.weights, best.chains, shares, linear.log_odds, priors)
    refits = {names: again(fit) for names, fit in {frozenset[str](): base, **fits.found}.items()}
    parts = _competing_parts(refits, _with_errors_of_formulas(_weighed(refits)), fits.tried | set(fits.found))
    fits = _best_of_each(fits, problem, base, parts, known, say)
    refits |= {names: again(fit) for names, fit in fits.found.items() if names not in refits}
    weighed = _weighed(refits)
    evidence = _with_errors_of_formulas(weighed)
    say.discard(STAGE)
    found = []
    for refit, pair in zip(refits.values(), weighed, strict=True):
        fit, names = refit.fit, tuple(sorted(refit.fit.names))
        additions, deviations = fit.additions, fit.deviations
        found.append(Explanation(names, evidence[frozenset(names)], False, 0.0, additions, deviations, fit.c))
        more = _with_discrepancy(*pair) + linear.log_odds
        found.append(Explanation(names, more, True, 0.0, additions, deviations, fit.c))
    return Alternatives.of(found)


def _weighed(refits: Mapping[frozenset[str], _Refit]) -> list[tuple[SecondOrder, float]]:
    """Each with the variance of residuals over its noise."""
    r = [one.amplified for one in refits.values()]
    left = [one.weighed.chi_square / max(one.fit.degrees, 1) for one in refits.values()]
    variances = residual_variances(left, r, refits[frozenset()].amplified)
    return [(one.weighed, float(variance)) for one, variance in zip(refits.values(), variances, strict=True)]


def _with_discrepancy(one: SecondOrder, variance: float) -> float:
    """Log evidence with residuals of such a variance, that of smooth disturbances averaged over a logarithmic grid."""
    return over_variances(lambda v: one.with_discrepancy(variance, v), float(one.smooth @ one.smooth))


def _with_errors_of_formulas(fits: Iterable[tuple[SecondOrder, float]]) -> dict[frozenset[str], float]:
    """Log evidence of every set of effects that was fitted, or is a part of one: with smooth errors of their formulas, or errors that look like what a larger set has beside it, all equally probable. fits: each with the variance of residuals over its noise."""
    found: dict[frozenset[str], list[float]] = {}
    for one, variance in fits:
        for size in range(min(len(one.names), 1), len(one.names) + 1):
            for kept in combinations(sorted(one.names), size):
                found.setdefault(frozenset(kept), []).append(one.log_evidence(variance, kept))
    return {names: float(special.logsumexp(each) - np.log(len(each))) for names, each in found.items()}


def _competing_parts(
    refits: Mapping[frozenset[str], _Refit],
    evidence: Mapping[frozenset[str], float],
    known: Collection[frozenset[str]],
) -> list[Additions]:
    """Sets that are not `known` and compete with the best, as a larger set has them; the best of them."""
    least = max(evidence.values()) - NEAR
    ranked = sorted((names for names in evidence if evidence[names] > least), key=lambda names: -evidence[names])
    found = []
    for names in ranked:
        whole = next((one for larger, one in refits.items() if names < larger), None)
        if names not in known and whole is not None:
            found.append(tuple(one for one in whole.fit.additions if one.effect.name in names))
    return [additions for additions in found if _is_complete(additions)][:PARTS]


def _is_complete(additions: Additions) -> bool:
    """Whether it has the effect that another is more of."""
    names = {one.effect.name for one in additions}
    return all(one.effect.beside is None or one.effect.beside.name in names for one in additions)


def _refitted(
    weights: Problem, chains: Sequence[Chain], shares: Mapping[str, float], log_odds: float, priors: Priors, fit: Fit
) -> _Refit:
    """In weights with the noise of its own, at the displacements of the best, with columns at its chains."""
    own = usual = model_weights.as_stiff(weights, fit.c, fit.additions)
    if model_weights.amplifying(weights, fit.additions) != weights.amplifying:
        own = model_weights.with_own_noise(weights, fit.c, fit.additions)
    again = effect_fit.refit(own, fit.c, fit.additions)
    amplified = np.exp((own.log_determinant - usual.log_determinant) / again.n_rows)
    return _Refit(again, _second_order(own, chains, again, shares, log_odds, priors), float(amplified))


def _additions(
    problem: Problem, linear: Evidence, subset: Subset, known: Mapping[str, Effect], priors: Priors
) -> Additions:
    """Effects as the linear estimate has them, within their bounds."""
    found = []
    for i, a in zip(subset.members, subset.amplitudes, strict=True):
        signature = linear.signatures[i]
        effect = known[signature.name]
        values = a * prior_deviations(problem, effect, priors) + [p.null for p in effect.amplitudes]
        bounded = (float(np.clip(v, p.lower, p.upper)) for v, p in zip(values, effect.amplitudes, strict=True))
        found.append(Addition(effect, tuple(bounded), signature.shape))
    return tuple(found)


def _fitted(
    problem: Problem, base: Fit, additions: Additions, known: Mapping[str, Effect]
) -> tuple[Problem, Fit] | None:
    """With its own weights, from the linear estimate, or a share of it where that is better; None where the fit runs away, or effects take the place of the material. An effect that
    ends as a simpler one is fitted on as that, where it is `known`."""
    start = additions
    for _ in range(TIMES):
        if equations.loss(problem, base.c, start) < base.loss:
            break
        start = tuple(a.nearer_null(START) for a in start)
    try:
        own, fit = weighted_fit.without_superfluous(*weighted_fit.fit_with_own_weights(problem, base.c, start))
        if any(map(_is_degenerate, fit.additions)):
            own, fit = weighted_fit.fit_with_weights(own, fit.c, _simpler(fit.additions, known))
    except errors.FitError:
        return None
    refused = fit.free_loss >= WORSE * base.free_loss or has_soft_base(fit, base, DEFAULT)
    refused |= not all(is_possible(problem, one) and is_told(problem, one) for one in fit.additions)
    refused |= any(map(_is_degenerate, fit.additions))
    refused |= is_at_bounds(problem, fit.additions)
    return None if refused else (own, fit)


def _is_degenerate(one: Addition) -> bool:
    return one.effect.is_degenerate(one.shape)


def _simpler(additions: Additions, known: Mapping[str, Effect]) -> Additions:
    """With the simpler effects that degenerate ones are, where these are known and not among them already."""
    found, names = [], {one.effect.name for one in additions}
    for one in additions:
        if _is_degenerate(one):
            effect, amplitudes, shape = one.effect.as_simpler(one.amplitudes, one.shape)
            if effect.name in known and effect.name not in names:
                one = Addition(known[effect.name], amplitudes, shape)
        found.append(one)
    return tuple(found)


def _best_of_each(
    fits: _Fits, problem: Problem, base: Fit, chosen: Sequence[Additions], known: Mapping[str, Effect], say: Resumable
) -> _Fits:
    """With fits from those that were not tried yet. Each takes a minute with a large test."""
    for additions in chosen:
        start = frozenset(a.effect.name for a in additions)
        if start in fits.tried:
            continue
        say(f"{STAGE} {len(fits.tried) + 1}: {' and '.join(a.effect.name for a in additions)}")
        weights, found = fits.weights, fits.found
        pair = _fitted(problem, base, additions, known)
        if pair is not None and (names := frozenset(pair[1].names)):
            if pair[1].free_loss < min((fit.free_loss for fit in found.values()), default=np.inf):
                weights = pair[0]
            if names not in found or pair[1].free_loss < found[names].free_loss:
                found = {**found, names: pair[1]}
        fits = _Fits(weights, found, fits.tried | {start})
        say.save(STAGE, fits)
    return fits


def _second_order(
    problem: Problem, chains: Sequence[Chain], fit: Fit, shares: Mapping[str, float], log_odds: float, priors: Priors
) -> SecondOrder:
    """Of a fit, with columns of the base and signatures at these chains; at the optimum of a base that may have any energy, and of its effects within their bounds."""
    U = base_span(problem, chains)
    r, D = fit.residual - U @ (U.T @ fit.residual), disturbances(problem, U)
    S, step = U[:, :0], np.zeros(0)
    if fit.additions:
        S = equations.signatures(problem, chains, fit.c, fit.additions)
        S = S - U @ (U.T @ S)
        variables = Variables(fit.additions)
        lower, upper = variables.bounds(problem.tests)
        step = bounded(S, -r, lower - variables.values, upper - variables.values)
        r = r + S @ step
    effects, shapes = [], [U]
    start = 0
    for one in fit.additions:
        p = len(one.amplitudes)
        change = step[start : start + p] + one.amplitudes - [parameter.null for parameter in one.effect.amplitudes]
        one_sided = np.array([parameter.lower == parameter.null for parameter in one.effect.amplitudes])
        log_prior = log_odds + float(np.log(shares.get(one.effect.name, 1.0)))
        L = prior_deviations(problem, one.effect, priors)
        own = S[:, start : start + p]
        error, sets = one.effect.formula_error, one.effect.sets
        effects.append(FittedEffect(one.effect.name, change, own, L, error, log_prior, one_sided, sets))
        shapes.append(S[:, start + p : start + p + len(one.shape)])
        start += p + len(one.shape)
    return SecondOrder(float(r @ r), D.T @ r, tuple(effects), np.concatenate(shapes, axis=1))
