"""Backward elimination: from a fit of all effects, those that BIC does not retain are taken out one at a time.

In: a `Problem` and candidates. Out: `Joint` fits: the whole, and the smaller ones on the way.

The effect is taken out whose absence raises the misfit least, until that costs more than the penalty on its parameters
(BIC; Schwarz 1978), the misfit being counted in units of the dispersion that the whole leaves (quasi-likelihood; Burnham and
Anderson 2002).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.joint import fit as joint_fit
from calibrate.diagnosis.joint.fit import Joint
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.score_tests import Score
from calibrate.effects.chain import Addition, Additions

Array = NDArray[np.float64]
NOTHING = 1e-2  # dispersions: an effect that costs less is taken out without a look at others
TRIED = 2  # effects that are refitted without, before one is taken out


def candidates(scores: Sequence[Score], nested: Sequence[str] = ()) -> Additions:
    """Tested effects at their null values, with the shapes that the score test found best; amplitudes that shapes need are
    started at a third of a typical one. nested: effects left out, because a more general one holds them."""
    result = []
    for one in scores:
        if not one.is_tested or one.effect.name in nested:
            continue
        values = [
            float(np.clip(p.null + 0.3 * p.typical, p.lower, p.upper)) if one.effect.shapes else p.null
            for p in one.effect.amplitudes
        ]
        result.append(Addition(one.effect, tuple(values), one.shape))
    return tuple(result)


def fits_of_all(problem: Problem, c: Array, additions: Additions, starts: int = 3, seed: int = 0) -> list[Joint]:
    """Fits with every candidate, the best first: from the null values, and from random ones of the typical size."""
    rng = np.random.default_rng(seed)
    active = frozenset(a.effect.name for a in additions)
    found = [joint_fit.fit(problem, c, additions, active)]
    for _ in range(starts - 1):
        moved = []
        for a in additions:
            values = (
                np.clip(v + p.typical * rng.normal(), p.lower, p.upper)
                for p, v in zip(a.effect.amplitudes, a.amplitudes, strict=True)
            )
            moved.append(replace(a, amplitudes=tuple(map(float, values))))
        found.append(joint_fit.fit(problem, c, tuple(moved), active))
    return sorted(found, key=lambda joint: joint.objective)


def eliminated(problem: Problem, start: Joint, say: Callable[[str], None] = lambda text: None) -> list[Joint]:
    """The fits on the way from the whole to what BIC retains, `start` first."""
    path, unit = [start], start.dispersion
    while path[-1].active:
        now = path[-1]
        net = {name: cost / unit - now.penalty([name]) for name, cost in now.costs.items()}
        likely = sorted(net, key=lambda name: net[name])
        does_nothing = now.costs[likely[0]] < NOTHING * unit
        tries = []
        for name in likely[: 1 if does_nothing else TRIED]:
            say(f"without {name}")
            tries.append(joint_fit.fit(problem, now.c, now.additions, now.active - {name}, name))
        best = min(tries, key=lambda joint: bic_rise(now, joint, unit))
        if bic_rise(now, best, unit) > 0:
            return path
        path.append(best)
    return path


def bic_rise(before: Joint, after: Joint, unit: float) -> float:
    """Rise of BIC from a model to the smaller one `after`: of the misfit, in units of dispersion, minus the penalty saved."""
    gone = before.active - after.active
    return (after.loss - before.loss) / unit - before.penalty(list(gone))
