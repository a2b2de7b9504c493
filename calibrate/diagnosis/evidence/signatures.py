"""Signatures of all effects at a base fit, over priors and noise, ready for `linear_evidence`.

In: a `Problem`, its base `Fit`, effects, priors. Out: `Evidence`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis import problem as equations
from calibrate.diagnosis import residual_tests, score_tests
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.evidence.linear_evidence import Evidence, Signature
from calibrate.diagnosis.evidence.priors import Priors, Scales, deviations
from calibrate.diagnosis.problem import Problem
from calibrate.effects import Effect
from calibrate.effects.chain import Addition
from calibrate.fitting.least_squares import orthonormal

Array = NDArray[np.float64]
Shape = tuple[float, ...]
EXPECTED = 0.5  # effects that a test is believed to have before it is looked at


def evidence(
    problem: Problem, base: Fit, effects: Sequence[Effect], priors: Priors, refined: Mapping[str, Shape]
) -> Evidence:
    """Of a base fit without effects. refined: shapes beside those of the grid, by the names of effects."""
    U = base.columns
    r = base.residual - U @ (U.T @ base.residual)
    found = [
        signature
        for effect in effects
        if score_tests.untestable(problem, effect) is None
        for signature in _of_effect(problem, base, effect, prior_deviations(problem, effect, priors), refined)
    ]
    D = residual_tests.smooth_disturbances(problem)
    D = orthonormal(D - U @ (U.T @ D))
    everything = orthonormal(np.concatenate([*(s.columns for s in found), D], axis=1))
    rest = r - everything @ (everything.T @ r)
    noise = np.sqrt(max(1.0, float(rest @ rest) / max(len(r) - U.shape[1] - everything.shape[1], 1)))
    found = [replace(s, columns=s.columns / noise) for s in found]
    names = {s.name for s in found}
    return Evidence(tuple(found), r / noise, D, float(np.log(EXPECTED / max(len(names), 1))))


def prior_deviations(problem: Problem, effect: Effect, priors: Priors) -> Array:
    """Of every amplitude (p,) of an effect, in its unit."""
    modulus = shear_modulus(problem)
    return deviations(effect, priors, [Scales.of_test(part.experiment, modulus) for part in problem.trained])


def shear_modulus(problem: Problem) -> float:
    """Twice the mean psi_1 of the base that the weights belong to, MPa."""
    positive = problem.c[problem.c > 0]
    return 2 * float(np.median(positive)) if len(positive) else 1.0


def _of_effect(
    problem: Problem, base: Fit, effect: Effect, deviation: Array, refined: Mapping[str, Shape]
) -> list[Signature]:
    grid = [tuple(shape) for shape in effect.shape_values(problem.trained[0].chain.data)]
    shapes = [*grid, refined[effect.name]] if effect.name in refined else grid
    null = tuple(p.null for p in effect.amplitudes)
    one_sided = np.array([p.lower == p.null for p in effect.amplitudes])
    U, found = base.columns, []
    for shape in shapes:
        S = equations.signature(problem, base.chains, base.c, (Addition(effect, null, shape),)) * deviation
        if np.isfinite(S).all():
            found.append(Signature(effect.name, shape, S - U @ (U.T @ S), 1 / len(grid), one_sided))
    return found
