"""Signatures of all effects at a base fit, over priors and noise, ready for `linear_evidence`.

In: a `Problem`, its base `Fit`, chains, effects, priors. Out: `Evidence`. Columns and signatures are those of the chains of the best model at
hand: their displacements are rid of the noise that shows in its residual (`signature_noise.denoised`). Those of a base that lacks something are
moved by what it lacks, too, and columns at them then follow the residual: smooth disturbances outside of such columns would explain noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis import problem as equations
from calibrate.diagnosis import residual_tests, score_tests
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.evidence.linear_evidence import Evidence, Signature
from calibrate.diagnosis.evidence.priors import Priors, Scales, deviations
from calibrate.diagnosis.problem import Problem
from calibrate.effects import Effect
from calibrate.effects.chain import Addition, Chain
from calibrate.equations.basis import energy_basis
from calibrate.fitting.least_squares import orthonormal
from calibrate.fitting.side_by_side import side_by_side

Array = NDArray[np.float64]
Shape = tuple[float, ...]
EXPECTED = 0.5  # effects that a test is believed to have before it is looked at


def evidence(
    problem: Problem,
    base: Fit,
    chains: Sequence[Chain],
    effects: Sequence[Effect],
    priors: Priors,
    refined: Mapping[str, Shape],
) -> Evidence:
    """Of a base fit without effects. refined: shapes beside those of the grid, by the names of effects."""
    chains = [one.remembering() for one in chains]
    U = base_span(problem, chains)
    r = base.residual - U @ (U.T @ base.residual)
    tested = [effect for effect in effects if score_tests.untestable(problem, effect) is None]

    def of(effect: Effect) -> list[Signature]:
        return _of_effect(problem, base.c, chains, U, effect, prior_deviations(problem, effect, priors), refined)

    found = list(chain.from_iterable(side_by_side(of, tested)))
    D = disturbances(problem, U)
    everything = orthonormal(np.concatenate([*(s.columns for s in found), D], axis=1))
    rest = r - everything @ (everything.T @ r)
    noise = np.sqrt(max(1.0, float(rest @ rest) / max(len(r) - U.shape[1] - everything.shape[1], 1)))
    found = [replace(s, columns=s.columns / noise) for s in found]
    names = {s.name for s in found}
    return Evidence(tuple(found), r / noise, D, float(np.log(EXPECTED / max(len(names), 1))))


def base_span(problem: Problem, chains: Sequence[Chain]) -> Array:
    """Orthonormal columns (N, k) that the base adjusts, within its prior."""
    return orthonormal(equations.base_columns(problem, chains) @ problem.cone)


def disturbances(problem: Problem, U: Array) -> Array:
    """Smooth disturbances (N, k), orthonormal, outside of columns U (N, n)."""
    D = residual_tests.smooth_disturbances(problem)
    return orthonormal(D - U @ (U.T @ D))


def prior_deviations(problem: Problem, effect: Effect, priors: Priors) -> Array:
    """Of every amplitude (p,) of an effect, in its unit."""
    return deviations(effect, priors, [Scales.of_test(part.experiment, modulus(problem)) for part in problem.trained])


def modulus(problem: Problem) -> float:
    """Twice the median psi_1 of the base that the weights belong to, MPa: steadier than that at rest, where strains are small."""
    energy = problem.weights_c[: energy_basis(problem.basis).n_functions]
    return 2 * float(np.median(energy[energy > 0]))


def _of_effect(
    problem: Problem,
    c: Array,
    chains: Sequence[Chain],
    U: Array,
    effect: Effect,
    deviation: Array,
    refined: Mapping[str, Shape],
) -> list[Signature]:
    grid = problem.shapes(effect)
    shapes = [*grid, refined[effect.name]] if effect.name in refined else grid
    null = tuple(p.null for p in effect.amplitudes)
    one_sided = np.array([p.lower == p.null for p in effect.amplitudes])
    beside = "" if effect.beside is None else effect.beside.name
    found = []
    share = 1 / (len(shapes) * len(effect.sets))
    for shape in shapes:
        S = equations.signature(problem, chains, c, (Addition(effect, null, shape),)) * deviation
        if np.isfinite(S).all():
            S = S - U @ (U.T @ S)
            signature = Signature(effect.name, shape, S, share, one_sided, beside, effect.formula_error)
            found += [replace(signature, columns=S * some) for some in effect.sets]
    return found
