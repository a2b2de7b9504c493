"""Negative control on measured sheets: between neighbouring pictures nothing happens, so that nothing may be found there.

Each odd picture is compared with the cubic through the two even ones before and the two after it. Every effect that grows
slowly, known or not, is in both and drops out of the difference to the third order in time (a straight line through two
leaves the curvature of fast relaxation in); what is left is the noise that changes from picture to picture. The score tests of
`equigap discover` are then run on the difference, with that noise: none may be significant.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment, Noise
from calibrate.diagnosis import base_fit, effect_fit, score_tests
from calibrate.diagnosis.problem import Part, Problem, all_rows
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Chain
from calibrate.equations import reduction
from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.weights import weights_of
from calibrate.errors import ExperimentError
from studies.sheets.sheet_results import ControlResult, EffectScore

Array = NDArray[np.float64]
AROUND = (-3, -1, 1, 3)  # even pictures around an odd one


def groups(time: Array, count: int) -> list[int]:
    """Numbers of the frames k - 3, k - 1, k, k + 1, k + 3 for at most `count` odd k spread over the record time (t,),
    s, none across a gap and no frame twice. Raises `ExperimentError` where there is none."""
    interval = np.median(np.diff(time))
    odd = [k for k in range(3, len(time) - 3, 2) if time[k + 3] - time[k - 3] < 6.5 * interval]
    if not odd:
        raise ExperimentError(
            f"the control needs a picture with three on either side and no gap between: {len(time)} pictures have none; record more of them, evenly in time"
        )
    chosen: list[int] = []
    for i in np.unique(np.linspace(len(odd) // 8, len(odd) - 1, count).astype(int)):
        if not chosen or odd[i] - chosen[-1] > 6:
            chosen.append(odd[i])
    return [k + step for k in chosen for step in sorted((*AROUND, 0))]


def interpolation(at: Array, times: Array) -> Array:
    """(..., 4): weights of the values at `times` (..., 4) in the cubic through them, `at` (...) another time (Lagrange)."""
    weights = np.ones(times.shape)
    for i in range(times.shape[-1]):
        for j in range(times.shape[-1]):
            if i != j:
                weights[..., i] *= (at - times[..., j]) / (times[..., i] - times[..., j])
    return weights


def from_neighbours(e: Experiment) -> Array:
    """(g, 4): weights of the even pictures of every group of e, see `groups`, in what the odd one is compared with."""
    assert e.time is not None
    times = e.time.reshape(-1, 5)
    return interpolation(times[:, 2], times[:, [0, 1, 3, 4]])


def split_half(e: Experiment, spacing: float, seed: int = 0) -> ControlResult:
    """Score tests of the difference between odd pictures and the even ones around them.

    e: its increments are those of `groups`, its noise is that from picture to picture. spacing: of the virtual
    fields, mm.
    """
    assert e.noise is not None
    weights = from_neighbours(e)
    factor = float(np.sqrt(1 + (weights**2).sum(axis=1).mean()))
    noise = Noise(factor * e.noise.displacement_std, e.noise.correlation_length, 0.0, factor * e.noise.force_std)
    odd, *even = [replace(e.select(np.arange(first, e.n_increments, 5)), noise=noise) for first in (2, 0, 1, 3, 4)]
    plain = [replace(odd, noise=None)]
    problem, fit = base_fit.prepare(plain, [all_rows], spacing, False, "positive")
    problem = _with_noise(problem, fit.c, odd)
    fit = effect_fit.refit(problem, fit.c, ())
    fields = problem.parts[0].system.fields
    here, *around = [Chain(Equilibrium(part, fields), problem.basis).residual(fit.c) for part in (odd, *even)]
    difference = here - sum(w[:, None] * r for w, r in zip(weights.T, around, strict=True))
    white = problem.whiten([difference])
    scores = score_tests.score(problem, replace(fit, residual=white), CATALOGUE, seed)
    tested = [s for s in scores if s.is_tested]
    U = fit.columns
    rest = white - U @ (U.T @ white)
    return ControlResult(
        name=e.name,
        pictures=odd.n_increments,
        reduced_chi_square=float(rest @ rest / (len(white) - U.shape[1])),
        smallest_adjusted_p=min((s.adjusted for s in tested), default=1.0),
        effects=[EffectScore(s.effect.name, s.score, s.degrees, s.adjusted) for s in tested],
    )


def _with_noise(problem: Problem, c: Array, e: Experiment) -> Problem:
    """The same problem with the noise of e and no allowance for discretisation, which drops out of a difference."""
    system = Equilibrium(e, problem.parts[0].system.fields)
    assembled = reduction.assemble(system, problem.basis)
    rows = all_rows(system)
    noise = assembled.noise_at(c)
    part = Part(
        Chain(system, problem.basis), assembled, train=weights_of(noise, rows), held=weights_of(noise, rows & False),
        shift=np.zeros(system.loads.shape), common=None,
    )  # fmt: skip
    return replace(problem, parts=(part,), noise_is_known=True)
