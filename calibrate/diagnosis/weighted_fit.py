"""Fits whose weights know the noise that their own effects amplify.

In: a `Problem`, effects, where to start. Out: the problem with the weights that belong to the fit, and the `Fit`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis import effect_fit, model_weights
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.problem import Problem
from calibrate.effects.chain import Addition, Additions
from calibrate.errors import FitError

Array = NDArray[np.float64]
NOTHING = 1e-6  # of the coefficients of the base, which is no base
TURNS, NEAR = 2, 0.5  # updates of the weights by a fit; standard deviations between both that are near enough


def fit_with_weights(problem: Problem, c: Array, additions: Additions) -> tuple[Problem, Fit]:
    """The fit with weights that know the noise of its second derivatives, see `model_weights.amplified`; as `refit` where no
    effect takes any.

    Weights and amplitudes answer each other in some turns at most: the next weights belong to the mean of both.
    """
    problem = model_weights.amplified(problem, additions)
    fit = effect_fit.refit(problem, c, additions)
    for _ in range(TURNS):
        if not _is_far([a for a in problem.amplifying if a.effect.rough], fit):
            break
        before = {a.effect.name: a for a in problem.amplifying}
        middle = tuple(_mean(before.get(a.effect.name, a), a) for a in fit.additions)
        problem = model_weights.amplified(problem, middle)
        fit = effect_fit.refit(problem, fit.c, fit.additions)
    return problem, fit


def _is_far(weights: Sequence[Addition], fit: Fit) -> bool:
    """Whether an effect that the weights know has other amplitudes in the fit."""
    found = {a.effect.name: (a.amplitudes, d) for a, d in zip(fit.additions, fit.errors, strict=True)}
    return any(
        abs(x - y) > NEAR * d
        for old in weights
        for x, y, d in zip(old.amplitudes, *found[old.effect.name], strict=True)
    )


def _mean(one: Addition, other: Addition) -> Addition:
    """The second with amplitudes half way to the first."""
    pairs = zip(one.amplitudes, other.amplitudes, strict=True)
    return replace(other, amplitudes=tuple(0.5 * (x + y) for x, y in pairs))


def fit_with_own_weights(problem: Problem, c: Array, additions: Additions) -> tuple[Problem, Fit]:
    """The fit whose weights belong to it: those of a base that makes up for a missing effect are wrong. Raises `FitError` where nothing is left of the base: it has no weights."""
    problem, fit = fit_with_weights(problem, c, additions)
    if not np.linalg.norm(fit.c) > NOTHING * np.linalg.norm(c):
        names = " and ".join(a.effect.name for a in additions)
        raise FitError(f"{names}: takes the place of the material, and leaves nothing of the base")
    return refitted(problem, fit)


def refitted(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """With the weights of a fit, at displacements without the noise that shows in its residual, and fitted again; once or twice more where an effect in the material has other amplitudes then:
    beside weights with a smaller relaxation its noise would be taken for a misfit, beside a larger one a misfit for noise."""
    for _ in range(1 + TURNS):
        problem = model_weights.reweighted(problem, fit.c, fit.additions, fit.chains)
        problem, fit = fit_with_weights(problem, fit.c, fit.additions)
        if not _is_far([a for a in problem.amplifying if a.effect.in_material], fit):
            break
    return problem, fit


def without_superfluous(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """The fit without effects that do not differ from none in it, as others make them superfluous; itself where there are none."""
    kept = fit.distinct
    if len(kept) == len(fit.additions):
        return problem, fit
    return fit_with_weights(problem, fit.c, tuple(_as_first(a, kept) for a in kept))


def _as_first(one: Addition, kept: Additions) -> Addition:
    """What continues an effect that is gone takes its place, as the one relaxation time that is left."""
    first = one.effect.beside
    gone = first is not None and all(a.effect.name != first.name for a in kept)
    return replace(one, effect=first) if first is not None and gone else one
