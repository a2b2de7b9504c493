"""Leave-one-out fits: which effects BIC retains without each increment, and how much hangs on single pictures.

In: the increments that are fitted and a fit of every effect to them. Out: a `Joint` for each increment left out, beside
neo-Hooke; a finer base is not selected again. A choice among models that fit alike turns over with small changes of the data;
the mean over such changes is steadier than any one of them (bagging; Breiman 1996), and their spread says how much the choice
matters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.diagnosis import base_fit, base_functions, effect_fit
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.joint import elimination
from calibrate.diagnosis.joint import fit as joint_fit
from calibrate.diagnosis.joint.everything import NESTED, simple_base
from calibrate.diagnosis.joint.fit import Joint
from calibrate.diagnosis.parameters import n_parameters
from calibrate.diagnosis.problem import Problem
from calibrate.effects import Effect
from calibrate.effects.chain import Addition
from studies.sheets.model_errors import equations

Mask = NDArray[np.bool_]
Say = Callable[[str], None]


def prepared(e: Experiment, fitted: Mask, spacing: float) -> tuple[Problem, Fit]:
    """Problem of the increments fitted (t,), whose base is neo-Hooke, and its base fit."""
    problem, _ = base_fit.prepare([e], [lambda system: equations(system, fitted)], spacing, base="positive")
    problem = simple_base(problem)
    return problem, effect_fit.refit(problem, base_functions.first_guess([problem.parts[0].assembled]), ())


def penalised_misfit(n: int, one: Joint, unit: float) -> float:
    """Misfit over dispersion, and log of the number of equations for each of the n functions of the base and each parameter (BIC)."""
    return one.loss / unit + (n + sum(map(n_parameters, one.present))) * float(np.log(one.n_rows))


def retain(
    problem: Problem, start: Joint, special: dict[str, Effect], say: Say
) -> tuple[list[Joint], Joint, list[str]]:
    """Effects taken out one at a time (the path, `start` first), the fit it ends at with special effects in the place of general
    ones that are no better, and the names of these special ones."""
    path = elimination.eliminated(problem, start, say)
    now, exchanged = path[-1], []
    for name, effect in special.items():
        if NESTED[name] not in now.active:
            continue
        say(f"{name} instead of {NESTED[name]}")
        best = _exchanged(problem, now, effect, NESTED[name])
        if penalised_misfit(1, best, start.dispersion) < penalised_misfit(1, now, start.dispersion):
            now = best
            exchanged.append(name)
    return path, now, exchanged


def _exchanged(problem: Problem, now: Joint, special: Effect, general: str) -> Joint:
    """The best fit with a special effect instead of a general one, from every place where it may be."""
    others = tuple(a for a in now.additions if a.effect.name != general)
    active = now.active - {general} | {special.name}
    found = []
    for one in special_starts(next(a for a in now.additions if a.effect.name == general), special):
        found.append(joint_fit.fit(problem, now.c, (one, *others), active))
    return min(found, key=lambda one: one.objective)


def special_starts(general: Addition, special: Effect) -> list[Addition]:
    """Where a special effect is started: one family of fibres along either of two, and between them as stiff as both together."""
    if not special.shapes:
        return [Addition(special, tuple(p.null for p in special.amplitudes), ())]
    (k,), (axis, half) = general.amplitudes, general.shape
    apart = [Addition(special, (k,), (axis + turn,)) for turn in (-half, half)] if half > 0.05 else []
    return [Addition(special, (2 * k,), (axis,)), *apart]


def leave_one_out_fits(
    early: Experiment, every: Joint, special: dict[str, Effect], spacing: float, say: Say
) -> Iterator[tuple[int, Joint]]:
    """Each fitted increment, and what is retained without it; every: the fit of all effects to all increments, the start."""
    for left_out in range(early.n_increments):
        fitted = np.arange(early.n_increments) != left_out
        say(f"fit without increment {left_out + 1} of {early.n_increments}")
        problem, _ = prepared(early, fitted, spacing)
        start = joint_fit.fit(problem, every.c, every.additions, every.active)
        yield left_out, retain(problem, start, special, lambda text: None)[1]
