"""The best subsets fitted without linearisation, and their probabilities.

In: the base, subsets ranked by `linear_evidence`. Out: `Alternatives`. Each subset is fitted with the weights that belong to it, and its
evidence is Laplace's approximation there (MacKay 1992):

    ln Z = -1/2 chi^2 - 1/2 |a / L|^2 - 1/2 ln |1 + L S^T S L| + ln prior odds

with chi^2 of what the base cannot absorb, allowing for the error of the formulas. All have weights and columns of one model, that which leaves
least, and are refitted: with its own, a model would judge itself. But noise of the displacements makes errors of the equations in proportion to the stiffness: each
model has the stiffness of its own base in them, or a softer one would win.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.diagnosis import effect_fit, model_weights, weighted_fit
from calibrate.diagnosis import problem as equations
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.evidence.explanations import Alternatives, Explanation
from calibrate.diagnosis.evidence.linear_evidence import FORMULA_ERROR, Evidence, Subset, over_variances
from calibrate.diagnosis.evidence.priors import Priors
from calibrate.diagnosis.evidence.signatures import base_span, disturbances, prior_deviations
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.selection.candidate_fit import has_soft_base, is_possible
from calibrate.diagnosis.selection.thresholds import DEFAULT
from calibrate.effects import Effect
from calibrate.effects.chain import Addition, Additions, Chain
from calibrate.fitting.resumable import SILENT, Resumable

Array = NDArray[np.float64]
START, SHARES = (
    0.5,
    4,
)  # share of the linear estimate that a fit starts from where the whole has a larger misfit, taken so often
STAGE = "explanation"
WORSE = 2.0  # times the misfit of the base: the fit ran away


@dataclass(frozen=True, eq=False)
class _Refit:
    """A subset fitted. chi_square: of what the base cannot absorb; smooth (k,): the squares along smooth disturbances in it; strength:
    |S a|^2 of its effects; occam: logarithm of prior and volume."""

    fit: Fit
    chi_square: float
    smooth: Array
    strength: float
    occam: float = 0.0

    def log_evidence(self, noise: float, variance: float | None = None) -> float:
        """noise: variance of all residuals. variance: of smooth disturbances (None: of the error of the formulas)."""
        v = FORMULA_ERROR**2 * self.strength / noise / len(self.smooth) if variance is None else variance
        chi_square = self.chi_square / noise - v / (1 + v) * float(self.smooth.sum()) / noise
        return -0.5 * (chi_square + len(self.smooth) * np.log1p(v)) + self.occam

    def with_discrepancy(self, noise: float) -> float:
        """The variance of smooth disturbances averaged over a logarithmic grid."""
        return over_variances(lambda v: self.log_evidence(noise, v), float(self.smooth.sum()))


def alternatives(
    problem: Problem, base: Fit, effects: Sequence[Effect], linear: Evidence, subsets: Sequence[Subset], priors: Priors,
    say: Resumable = SILENT,
) -> Alternatives:  # fmt: skip
    """Fits of the subsets and of none, each with and without a discrepancy, and their probabilities. Fits that run away are left out, effects
    that a fit leaves at none as well: it is that of the smaller subset."""
    known = {effect.name: effect for effect in effects}
    shares = {s.name: s.prior for s in linear.signatures}
    chosen = [_additions(problem, linear, one, known, priors) for one in subsets if one.members]
    weights, own = _best_of_each(problem, base, chosen, known, say)
    best = min(own, key=lambda fit: fit.free_loss, default=base)
    say.discard(STAGE)
    refits = []
    for fit in (base, *own):
        its = model_weights.as_stiff(weights, fit.c, fit.additions)
        again = effect_fit.refit(its, fit.c, fit.additions)
        refits.append(_measured(its, best.chains, again, shares, linear.log_odds, priors))
    noise = max(1.0, min(one.fit.reduced_chi_square for one in refits))
    found = []
    for refit in refits:
        additions, deviations, names = refit.fit.additions, refit.fit.errors, tuple(sorted(refit.fit.names))
        c = refit.fit.c
        found.append(Explanation(names, refit.log_evidence(noise), False, 0.0, additions, deviations, c))
        more = refit.with_discrepancy(noise) + linear.log_odds
        found.append(Explanation(names, more, True, 0.0, additions, deviations, c))
    return Alternatives.of(found)


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
    for _ in range(SHARES):
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
    refused |= not all(is_possible(problem, one) for one in fit.additions) or any(map(_is_degenerate, fit.additions))
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
    problem: Problem, base: Fit, chosen: Sequence[Additions], known: Mapping[str, Effect], say: Resumable
) -> tuple[Problem, list[Fit]]:
    """The best fit of every set of effects, but of none, and the equations with the weights of the best of all. Each takes a minute with a large test."""
    reached: tuple[Problem, dict[frozenset[str], Fit], int] | None = say.load(STAGE)
    weights, found, done = reached or (problem, {}, 0)
    for i, additions in enumerate(chosen[done:], done + 1):
        say(f"{STAGE} {i}: {' and '.join(a.effect.name for a in additions)}")
        pair = _fitted(problem, base, additions, known)
        if pair is not None and (names := frozenset(pair[1].names)):
            least = min((fit.free_loss for fit in found.values()), default=np.inf)
            if names not in found or pair[1].free_loss < found[names].free_loss:
                found = {**found, names: pair[1]}
            if pair[1].free_loss < least:
                weights = pair[0]
        say.save(STAGE, (weights, found, i))
    return weights, list(found.values())


def _measured(
    problem: Problem, chains: Sequence[Chain], fit: Fit, shares: Mapping[str, float], log_odds: float, priors: Priors
) -> _Refit:
    """What the evidence of a fit is made of, with columns of the base and signatures at these chains."""
    U = base_span(problem, chains)
    r = fit.residual - U @ (U.T @ fit.residual)
    smooth = (disturbances(problem, U).T @ r) ** 2
    chi_square = float(r @ r)
    if not fit.additions:
        return _Refit(fit, chi_square, smooth, 0.0)
    outside = [s - U @ (U.T @ s) for s in (_signature(problem, chains, fit, i) for i in range(len(fit.additions)))]
    L = [prior_deviations(problem, a.effect, priors) for a in fit.additions]
    scaled = np.concatenate([s * one for s, one in zip(outside, L, strict=True)], axis=1)
    change = [np.array(a.amplitudes) - [p.null for p in a.effect.amplitudes] for a in fit.additions]
    strength = float(np.linalg.norm(sum(s @ a for s, a in zip(outside, change, strict=True))) ** 2)
    M = np.eye(scaled.shape[1]) + scaled.T @ scaled
    a = np.concatenate([c / one for c, one in zip(change, L, strict=True)])
    one_sided = sum(p.lower == p.null for addition in fit.additions for p in addition.effect.amplitudes)
    prior = sum(log_odds + np.log(shares.get(addition.effect.name, 1.0)) for addition in fit.additions)
    occam = -0.5 * float(a @ a) - 0.5 * float(np.linalg.slogdet(M)[1]) + one_sided * np.log(2) + prior
    return _Refit(fit, chi_square, smooth, strength, float(occam))


def _signature(problem: Problem, chains: Sequence[Chain], fit: Fit, i: int) -> Array:
    """Whitened (N, p) of the effect i beside the others."""
    others = fit.additions[:i] + fit.additions[i + 1 :]
    return equations.signature(problem, chains, fit.c, (*others, fit.additions[i]))
