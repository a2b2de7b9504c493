"""What a diagnosis leaves uncertain of the material it found: parameters, level, and explanations that compete with it.

In: a `Discovery`, priors. Out: `ModelUncertainty`. An effect of the material that is not in the model may still be there, as large as test and prior allow: with S its
signature over prior deviations L outside of what base and model adjust, and r the residual, both over the root of the dispersion, its amplitudes are L a with the posterior
N(m, M^-1), M = 1 + S^T S, m = -M^-1 S^T r, and the base makes up for them as far as it can. In deformation modes that a test does not hold, it cannot. An effect that is in the
model may have another form (`OTHER_FORMS`), which is as probable before the test: it is fitted in its place, and weighed by its misfit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from calibrate.diagnosis import problem as equations
from calibrate.diagnosis.evidence.explanations import Explanation
from calibrate.diagnosis.evidence.priors import Priors
from calibrate.diagnosis.evidence.signatures import prior_deviations
from calibrate.diagnosis.parameters import Variables
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.replayed.checked_replay import ReplayCheck
from calibrate.diagnosis.replayed.parameter_spread import Columns
from calibrate.diagnosis.selection.rounds import Discovery
from calibrate.effects import FORMS, Effect
from calibrate.effects.chain import Addition, Additions
from calibrate.fitting.least_squares import bounded
from calibrate.models.model_uncertainty import Competitor, Kind, ModelUncertainty

Array = NDArray[np.float64]
LEAST = 1e-3  # probability of a competitor that is kept
OTHER_FORMS: dict[str, Effect] = {"second invariant": FORMS[0]}


def uncertainty_of(found: Discovery, priors: Priors) -> ModelUncertainty | None:
    """Of the final model, before its level is that of the replay; None where its derivatives are not finite, or none: of a model without any stiffness."""
    columns = Columns.of(found.problem, found.final)
    if not (np.isfinite(columns.J).all() and columns.J.any()):
        return None
    spread = columns.spread
    p = columns.base.shape[1]
    root = np.concatenate([columns.base @ spread.root[:p], spread.root[p:]])
    competitors = (*_fitted(found), *_of_other_forms(found.problem, columns), *_undetected(found, columns, priors))
    times = [_last_time(part.fitted_increments, part.experiment.time) for part in found.problem.trained]
    replayed = found.replay_check.final if isinstance(found.replay_check, ReplayCheck) else None
    return ModelUncertainty(
        root,
        competitors,
        0.0 if replayed is None else replayed.deviation,
        0.0 if replayed is None or replayed.fitted is None else _known(replayed.fitted.force),
        max((t for t in times if t is not None and t > 0), default=None),
    )


def _known(error: float) -> float:
    return error if np.isfinite(error) else 0.0


def _last_time(fitted: NDArray[np.bool_], time: Array | None) -> float | None:
    """Of the increments (t,) that were fitted."""
    return None if time is None or not fitted.any() else float(time[fitted].max())


def _fitted(found: Discovery) -> Iterator[Competitor]:
    """Explanations that were fitted, but for that of the model itself."""
    known: dict[frozenset[str], list[Explanation]] = {}
    for one in _explanations(found):
        if one.c is not None and frozenset(one.names) != frozenset(found.final.names):
            known.setdefault(frozenset(one.names), []).append(one)
    for same in known.values():
        probability, c = sum(one.probability for one in same), same[0].c
        if probability > LEAST and c is not None:
            yield Competitor(min(probability, 1.0), c, same[0].additions, Kind.EXPLANATION)


def _explanations(found: Discovery) -> tuple[Explanation, ...]:
    return () if found.weighing is None else found.weighing.alternatives.explanations


def _of_other_forms(problem: Problem, columns: Columns) -> Iterator[Competitor]:
    """The model with an effect in another form, and base and other effects that make up for the difference, to first order; the base stays within its cone."""
    fit, n = columns.fit, columns.base.shape[1]
    ends = n + np.cumsum([len(a.amplitudes) + len(a.shape) for a in fit.additions])
    least = np.concatenate([-columns.weights, np.full(columns.J.shape[1] - n, -np.inf)])
    for i, (addition, end) in enumerate(zip(fit.additions, ends, strict=True)):
        new = OTHER_FORMS.get(addition.effect.name)
        if new is None:
            continue
        own = slice(int(end) - len(addition.amplitudes) - len(addition.shape), int(end))
        others, kept = fit.additions[:i] + fit.additions[i + 1 :], np.delete(np.arange(columns.J.shape[1]), own)
        null = Addition(new, tuple(p.null for p in new.amplitudes))
        S = equations.signature(problem, fit.chains, fit.c, (*others, null))
        if not np.isfinite(S).all():
            continue
        without = fit.residual - columns.J[:, own] @ (
            np.array(addition.amplitudes) / columns.scale[own.start - n : own.stop - n]
        )
        X, floor = np.hstack([columns.J[:, kept], S]), np.concatenate([least[kept], np.zeros(S.shape[1])])
        moved, left = _optimum(X, without, floor)
        gain = -0.5 * (left - _optimum(columns.J, fit.residual, least)[1]) / columns.dispersion
        form = replace(null, amplitudes=tuple(map(float, moved[len(kept) :])))
        additions = (*_moved(others, moved[n : len(kept)]), form)
        yield Competitor(float(expit(gain)), fit.c + columns.base @ moved[:n], additions, Kind.FORM)


def _optimum(X: Array, r: Array, least: Array) -> tuple[Array, float]:
    """Changes (k,) by columns X (N, k), of at least `least` (k,), that leave least of a residual r (N,), and the square of what they leave."""
    moved = bounded(X, -r, least, np.full(len(least), np.inf))
    return moved, float(np.linalg.norm(r + X @ moved) ** 2)


def _moved(additions: Additions, change: Array) -> Additions:
    """change (k,) of amplitudes and shapes, over their scale."""
    if not additions:
        return ()
    variables = Variables(additions)
    return variables.at(variables.values + change * variables.scale)


def _undetected(found: Discovery, columns: Columns, priors: Priors) -> Iterator[Competitor]:
    """Effects of the material that were tested and are not in the model, beside it, as probable as all explanations with them that were not fitted: one for each axis of their
    amplitudes. None where these probabilities are provisional."""
    if found.weighing is None or found.weighing.is_provisional:
        return
    problem, inside, tested = found.problem, set(found.final.names), {}
    for one in found.rounds[-1].candidates:
        if one.score.is_tested and one.score.effect.of_material and one.name not in inside:
            tested[one.name] = one.score
    for name, score in tested.items():
        open_to = sum(one.probability for one in _explanations(found) if one.c is None and name in one.names)
        if open_to > LEAST:
            L = prior_deviations(problem, score.effect, priors)
            yield from _as_large_as_it_may_be(problem, columns, score.effect, score.shape, L, min(open_to, 1.0))


def _as_large_as_it_may_be(
    problem: Problem, columns: Columns, effect: Effect, shape: tuple[float, ...], L: Array, probability: float
) -> Iterator[Competitor]:
    """L (p,): prior deviations of the amplitudes."""
    fit, null = columns.fit, tuple(p.null for p in effect.amplitudes)
    S = equations.signature(problem, fit.chains, fit.c, (*fit.additions, Addition(effect, null, shape))) * L
    if not np.isfinite(S).all():
        return
    size = np.maximum(np.linalg.norm(columns.J, axis=0), 1e-300)
    made_up = -np.linalg.lstsq(columns.J / size, S, rcond=None)[0] / size[:, None]
    outside = S + columns.J @ made_up
    inverse = np.linalg.inv(np.eye(len(L)) + outside.T @ outside / columns.dispersion)
    mean = -inverse @ outside.T @ fit.residual / columns.dispersion
    values, axes = np.linalg.eigh(inverse + np.outer(mean, mean))
    n = columns.base.shape[1]
    for a in (axes * np.sqrt(values)).T:
        a = _admissible(a, effect, L)
        moved = made_up @ a
        new = Addition(effect, tuple(map(float, null + L * a)), shape)
        additions = (*_moved(fit.additions, moved[n:]), new)
        yield Competitor(probability, fit.c + columns.base @ moved[:n], additions, Kind.UNSEEN)


def _admissible(a: Array, effect: Effect, L: Array) -> Array:
    """a (p,), or -a, which is as probable to first order, where that is nearer to what amplitudes may be."""
    null = np.array([p.null for p in effect.amplitudes])
    lower, upper = (np.array([getattr(p, name) for p in effect.amplitudes]) for name in ("lower", "upper"))
    beyond = [float(np.abs(v - np.clip(v, lower, upper)).sum()) for v in (null + L * a, null - L * a)]
    return a if beyond[0] <= beyond[1] else -a
