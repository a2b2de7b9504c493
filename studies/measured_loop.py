"""The loop closed on one measured sheet: effects added in order of their evidence where they predict better.

In: an Experiment. Out: a dictionary of plain numbers with every model, its errors and what was tried.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate import diagnosis, discovery, discrepancy
from calibrate.chain import Addition
from calibrate.diagnosis import Fit, Problem
from calibrate.effects import CATALOGUE, Effect, Parameter, SecondViscosity
from calibrate.effects.viscosity import Viscosity
from calibrate.effects.warp import InitialWarp, UnevenWarp
from calibrate.experiment import Experiment
from calibrate.extended import ExtendedModel, fingerprint
from calibrate.whitening import covariances, whitening
from studies.measured_account import Split, account, equations

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Say = Callable[[str], None]
KNOWN = ("force offset", "lag between force and image")  # the record says: no force at rest, pictures in time to 0.15 s
RELAXATION = (0.5, 2.0, 8.0, 32.0)  # s, times of the branches tried
FASTEST = 0.5  # s: a third of the time between increments; what relaxes faster is told by its product g tau alone


@dataclass(frozen=True)
class Relaxation(Viscosity):
    """A Prony branch that the increments can resolve."""

    shapes = (Parameter("tau", "s", lower=FASTEST),)

    def shape_values(self, data: Any) -> list[tuple[float, ...]]:
        return [(tau,) for tau in RELAXATION]


@dataclass(frozen=True)
class SecondRelaxation(Relaxation):
    """A second one."""

    name = SecondViscosity.name


INSTEAD: dict[str, Effect] = {Viscosity.name: Relaxation(), InitialWarp.name: UnevenWarp()}
EVERY = (*(INSTEAD.get(e.name, e) for e in CATALOGUE), SecondRelaxation())
EFFECTS = tuple(effect for effect in EVERY if effect.name not in KNOWN)
AFTER = {SecondRelaxation.name: Viscosity.name}  # effects that mean nothing before another one is there
SPLINES = (1, 2, 3, 5, 8, 12)  # of the base model
FINER = 2  # bases that are tried in each round
MOST, ITERATIONS = 7, 4  # additions at most; steps of a fit that is tried
PAYS = 0.05  # share by which an addition must lower the error of what confirms


def prepared(e: Experiment, split: Split, spacing: float, base: str, splines: int = 1) -> tuple[Problem, Fit]:
    """Problem whose held-out equations are those of the confirming increments alone, and its base fit."""
    problem, fit = diagnosis.prepare([e], [lambda system: equations(system, split.fitted)], spacing, base=base)
    part = problem.parts[0]
    confirms = equations(part.system, split.confirms) & diagnosis.all_rows(part.system)
    held = whitening(covariances(part.assembled, fit.c), confirms, _common(problem, fit))
    problem = with_splines(replace(problem, parts=(replace(part, held=held),)), base, splines)
    return problem, diagnosis.refit(problem, diagnosis.first_guess([part.assembled]), ())


def _common(problem: Problem, fit: Fit) -> Array | None:
    return discrepancy.sources(problem.parts[0].system, problem.basis, fit.c)


def with_splines(problem: Problem, base: str, n: int) -> Problem:
    """The problem with a base energy of n functions of I1."""
    top = max(diagnosis.trained_top(part.system, part.train.rows) for part in problem.trained)
    start = diagnosis.first_guess([part.assembled for part in problem.trained])
    prior = diagnosis.smoothness(base, n) / (diagnosis.STIFFENING * float(start.max()))
    return replace(problem, cone=diagnosis.base_cone(problem.basis, base, top, n), prior=prior, parametric=True)


@dataclass(frozen=True, eq=False)
class Round:
    """A model, its errors on what was fitted and what confirms, the tests of what it leaves, and what was added."""

    problem: Problem
    fit: Fit
    train: discovery.Misfit | None
    held: discovery.Misfit | None
    scores: list[diagnosis.Score]
    confirmed: dict[str, float]
    added: str | None = None

    @property
    def splines(self) -> int:
        return self.problem.cone.shape[1]


def close_loop(problem: Problem, state: Fit, base: str, say: Say) -> list[Round]:
    """Add effects in the order of their evidence, where they lower the error of what confirms; until none does.

    The base starts as neo-Hooke and is made finer only when no effect helps: many splines take up whatever varies with the
    load, time among it, and extrapolate badly. Of effects with one signature the one that predicts best is taken; of those with
    nearly the best score, which is that of small effects, the one that leaves the smallest misfit. The order follows the score and not the gain in prediction, because an effect that is small but alone in what it does (relaxation)
    shows only when those that disturb everything (a sheet that was not flat) are in the model.
    """
    rounds: list[Round] = []
    while True:
        say(f"round {len(rounds) + 1}: testing effects")
        present = {a.effect.name for a in state.additions}
        scores = diagnosis.score(
            problem, state, [x for x in EFFECTS if AFTER.get(x.name, x.name) in {x.name, *present}]
        )
        errors_ = [discovery.misfit(problem, state.c, state.additions, held) for held in (False, True)]
        now = Round(problem, state, errors_[0], errors_[1], scores, {})
        found = _next(now, base, lambda text: say(f"round {len(rounds) + 1}: {text}")) if len(rounds) < MOST else None
        if found is None:
            return [*rounds, now]
        rounds.append(replace(now, added=found[0]))
        _, problem, state = found


def _next(now: Round, base: str, say: Say) -> tuple[str, Problem, Fit] | None:
    """What is added, with the problem and the fit that follow; errors of all that is tried go to `now.confirmed`."""
    assert now.held is not None
    limit = (1 - PAYS) * both(now.held)
    fits: dict[str, tuple[float, Problem, Fit]] = {}

    def tried(name: str, problem: Problem, *starts: Addition | None) -> float:
        if name not in fits:
            say(f"fit with {name}")
            found = [fit for start in starts if (fit := _refit(problem, now.fit, start)) is not None]
            fit = min(found, key=lambda fit: fit.loss, default=None)
            held = None if fit is None else discovery.misfit(problem, fit.c, fit.additions, True)
            fits[name] = (np.inf if held is None else both(held), problem, now.fit if fit is None else fit)
            if held is not None:
                now.confirmed[name] = both(held)
        return fits[name][0]

    tested = [one for one in now.scores if one.status == "tested"]
    like = diagnosis.likeness(tested)
    significant = [i for i, one in enumerate(tested) if one.adjusted < discovery.ALPHA]
    top = max((tested[i].evidence for i in significant), default=0.0)
    rivals = [i for i in significant if tested[i].evidence > discovery.RIVAL * top]
    chosen: list[tuple[float, str]] = []
    for i in significant:
        group = [tested[j] for j in significant if j == i or like[i, j] > diagnosis.COLLINEAR]
        lowest = min(group, key=lambda other: tried(other.effect.name, now.problem, *_starts(now.problem, other)))
        error, _, fit = fits[lowest.effect.name]
        if error < limit:
            chosen.append((fit.loss, lowest.effect.name))
        if chosen and i not in rivals[:-1]:
            name = min(chosen)[1]
            return name, *fits[name][1:]
    for n in [n for n in SPLINES if n > now.splines][:FINER]:
        name = f"base of {n} splines"
        if tried(name, with_splines(now.problem, base, n), None) < limit:
            return name, *fits[name][1:]
    return None


def _starts(problem: Problem, one: diagnosis.Score) -> list[Addition]:
    """Additions at the amplitude of the score test, or at the null value where that is not admissible; times at several."""
    null = tuple(p.null for p in one.effect.amplitudes)
    starts = [Addition(one.effect, one.amplitudes if one.admissible else null, one.shape)]
    if isinstance(one.effect, Viscosity):
        shapes = one.effect.shape_values(problem.parts[0].chain.data)
        starts += [Addition(one.effect, null, shape) for shape in shapes if shape != one.shape]
    return starts


def both(misfit: discovery.Misfit) -> float:
    """Error of force and of field in one number: a factor on either counts alike, however many equations it has."""
    return float(np.sqrt(misfit.force * misfit.field))


def _refit(problem: Problem, state: Fit, addition: Addition | None) -> Fit | None:
    """The fit with one more effect; None where it is not told from its null value, or its stresses are not finite."""
    additions = state.additions if addition is None else (*state.additions, addition)
    try:
        fit = diagnosis.refit(problem, state.c, additions, ITERATIONS)
    except ValueError:
        return None
    if not np.isfinite(fit.loss):
        return None
    if addition is None:
        return fit
    null = (p.null for p in addition.effect.amplitudes)
    changed = (abs(a - p) >= 2 * d for a, p, d in zip(fit.additions[-1].amplitudes, null, fit.errors[-1], strict=True))
    return fit if any(changed) else None


def base_name(splines: int) -> str:
    """'neo-Hooke' or how many splines."""
    return "neo-Hooke" if splines == 1 else f"{splines} splines"


def verdict(last: Fit, scores: Sequence[diagnosis.Score]) -> str:
    """'explained' only if what the last model leaves is noise."""
    if last.p_value > discovery.GLOBAL and not any(
        s.status == "tested" and s.adjusted < discovery.ALPHA for s in scores
    ):
        return "explained" if last.additions else "nothing significant"
    return "significant, not explained"


def learn(e: Experiment, until: float, spacing: float, base: str, say: Say) -> dict[str, Any]:
    """Close the loop on a sheet: what is added, with errors before and after; everything that the report shows."""
    split = Split.of(e, until)
    say(f"{e.name}: base model")
    problem, fit = prepared(e, split, spacing, base)
    everything = replace(split, fitted=split.fitted | split.confirms)
    rounds = close_loop(problem, fit, base, lambda text: say(f"{e.name}: {text}"))
    whole, start = prepared(e, everything, spacing, base)
    result: dict[str, Any] = {
        "name": e.name,
        "spacing": spacing,
        "time": e.time,
        "split": {name: np.flatnonzero(mask).tolist() for name, mask in split.parts().items()},
        "verdict": verdict(rounds[-1].fit, rounds[-1].scores),
        "closest": [a.effect.name for a in rounds[-1].fit.additions],
        "models": [],
        "rounds": [],
    }
    for now in rounds:
        say(f"{e.name}: all of the first {until:g} s")
        whole = with_splines(whole, base, now.splines)
        try:
            final = diagnosis.refit(whole, start.c, now.fit.additions)
        except ValueError:  # not finite on the way: as it was found
            final = now.fit
        model = ExtendedModel(
            whole.basis,
            final.c,
            final.additions,
            final.errors,
            e.stress_unit,
            ({"name": e.name, "fingerprint": fingerprint(e)},),
            f"increments after {until:g} s",
            verdict=verdict(now.fit, now.scores),
        )
        result["models"].append(
            {
                "name": " + ".join([base_name(now.splines), *(a.effect.name for a in final.additions)]),
                "reduced_chi_square": final.reduced_chi_square,
                "splines": now.splines,
                "selection": {
                    "reduced_chi_square": now.fit.reduced_chi_square,
                    "fitted": _errors(now.train),
                    "confirming": _errors(now.held),
                },
                "amplitudes": [
                    {"effect": a.effect.name, "name": p.name, "unit": p.unit, "value": v, "deviation": d}
                    for a, deviations in zip(final.additions, final.errors, strict=True)
                    for p, v, d in zip(a.effect.amplitudes, a.amplitudes, deviations, strict=True)
                ],
                "model": model.to_dict(),
                **account(e, model, split, spacing),
            }
        )
        tested = [s for s in now.scores if s.status == "tested"]
        like = diagnosis.likeness(tested)
        result["rounds"].append(
            {
                "added": now.added,
                "error": None if now.held is None else both(now.held),
                "bases": {name: error for name, error in now.confirmed.items() if name.startswith("base of")},
                "candidates": [
                    {
                        "effect": one.effect.name,
                        "score": one.score,
                        "adjusted_p": one.adjusted,
                        "share": one.share,
                        "admissible": one.admissible,
                        "confirming_error": now.confirmed.get(one.effect.name),
                        "like": [
                            tested[j].effect.name
                            for j in range(len(tested))
                            if j != i and like[i, j] > diagnosis.COLLINEAR
                        ],
                        "decided_by": one.effect.decided_by,
                    }
                    for i, one in enumerate(tested)
                ],
            }
        )
    return result


def _errors(misfit: discovery.Misfit | None) -> dict[str, float] | None:
    if misfit is None:
        return None
    return {"force": misfit.force, "field": misfit.field, "chi_square": misfit.chi_square}
