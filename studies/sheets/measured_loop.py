"""What a measured sheet does beyond hyperelasticity: all effects fitted at once, and those that BIC does not retain removed.

In: an Experiment. Out: a dictionary of plain numbers with every model, its errors and what each effect is worth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from calibrate.data.experiment import Experiment
from calibrate.diagnosis import elimination, joint_fit, score_tests
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.joint_fit import Joint
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.selection import DEFAULT, Verdict
from calibrate.effects import CATALOGUE, Effect, Parameter, SecondViscosity
from calibrate.effects.viscosity import Viscosity
from calibrate.effects.warp import InitialWarp, UnevenWarp
from studies.reports.discovery.candidate_outcome import untested_words
from studies.sheets.leave_one_out import NESTED, leave_one_out_fits, penalised_misfit, prepared, retain, with_splines
from studies.sheets.model_errors import (
    BASE,
    EVERY_EFFECT,
    MEAN,
    RETAINED,
    Split,
    entry,
    force_and_field,
    members,
)
from studies.sheets.sheet_models import SheetModels, base_name

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Say = Callable[[str], None]
KNOWN = ("force offset", "lag between force and image")  # the record says: no force at rest, pictures in time to 0.15 s
ROUGH = ("3D effect of thickness", "subset smoothing")  # second derivatives, far below the virtual fields of 12 mm
RELAXATION = (0.5, 2.0, 8.0, 32.0)  # s, times of the branches tried
FASTEST = 0.5  # s: a third of the time between increments; what relaxes faster is told by its product g tau alone
SPLINES = (2, 3, 5)  # of base models that are tried instead of neo-Hooke
VALIDATION_PARTS = 3  # one part of so many of what is fitted, the last, is predicted from the others to choose the base


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

    def shape_values(self, data: Any) -> list[tuple[float, ...]]:
        return [(RELAXATION[-1],)]


INSTEAD: dict[str, Effect] = {Viscosity.name: Relaxation(), InitialWarp.name: UnevenWarp()}
EVERY = (*(INSTEAD.get(e.name, e) for e in CATALOGUE), SecondRelaxation())
EFFECTS = tuple(effect for effect in EVERY if effect.name not in (*KNOWN, *ROUGH))
BY_NAME = {effect.name: effect for effect in EFFECTS}


def learn(e: Experiment, until: float, spacing: float, say: Say) -> dict[str, Any]:
    """What is beyond neo-Hooke in the increments up to `until`, with errors after it; everything that the report shows.

    All candidates are fitted at once, from several starts; those that BIC does not retain are removed (`calibrate.diagnosis.joint_fit`); a general
    effect gives way to a special one where that lowers BIC, and neo-Hooke to a finer base where that also predicts the last third of what
    is fitted from the rest. Effects are selected once more without each increment, beside neo-Hooke
    (`studies.sheets.leave_one_out`). until: s; spacing: of the virtual fields, mm.
    """
    split = Split.of(e, until)
    assert e.time is not None

    def tell(text: str) -> None:
        say(f"{e.name}: {text}")

    tell("base model")
    early = e.select(np.flatnonzero(split.fitted))
    problem, base = prepared(early, np.ones(early.n_increments, bool), spacing)
    scores = score_tests.score(problem, base, EFFECTS)
    start = elimination.candidates(scores, tuple(NESTED))
    special = {name: BY_NAME[name] for name in NESTED if name in BY_NAME}
    tell(f"all {len(start)} effects")
    starts = elimination.fits_of_all(problem, base.c, start)
    path, reduced, exchanged = retain(problem, starts[0], special, tell)
    models = SheetModels(e, early, split, spacing, until, problem)
    bases = _bases(problem, reduced, early, starts[0].dispersion, spacing, tell)
    chosen = min((one for one in bases if one.validates(bases[0])), key=lambda one: one.penalised_misfit)
    left_out = list(leave_one_out_fits(early, starts[0], special, spacing, tell))
    found = _Learnt(base, starts, path, exchanged, bases, chosen, left_out)
    result = {
        "name": e.name,
        "spacing": spacing,
        "time": e.time,
        "split": {name: np.flatnonzero(mask).tolist() for name, mask in split.parts().items()},
        "not_testable": {s.effect.name: untested_words(s) for s in scores if not s.is_tested},
        **found.to_dict(models, e.time[split.fitted]),
    }
    first, retained, mean = (entry(result, name)["errors"] for name in (BASE, RETAINED, MEAN))
    result["predicts"] = predicts(first, retained) and predicts(first, mean)
    result["verdict"] = verdict(chosen.fit, result["predicts"])
    for model in result["models"][-2:]:
        for member in model["members"]:
            member["verdict"] = result["verdict"]
    unit, effects = starts[0].dispersion, sorted(chosen.fit.active)
    result["without"] = [_without(problem, chosen, name, unit, models, tell) for name in effects]
    result["closest"] = [line["effect"] for line in sorted(result["without"], key=lambda line: -line["rise"])]
    return result


@dataclass(frozen=True)
class _Learnt:
    """All fits to one sheet: the base, starts with every effect, the path of effects removed, special effects in the place of general
    ones, bases, the one chosen, and the leave-one-out fits with their increments."""

    base: Fit
    starts: Sequence[Joint]
    path: Sequence[Joint]
    exchanged: Sequence[str]
    bases: Sequence[Base]
    chosen: Base
    left_out: Sequence[tuple[int, Joint]]

    @property
    def fits(self) -> list[Joint]:
        """Every fit that may have stopped early."""
        return [*self.starts, *self.path, *(one.fit for one in self.bases), *(one for _, one in self.left_out)]

    def to_dict(self, models: SheetModels, time: Array) -> dict[str, Any]:
        """Plain numbers. time: of the fitted increments, s."""
        unit, chosen = self.starts[0].dispersion, self.chosen
        return {
            "dispersion": unit,
            "equations": self.starts[0].n_rows,
            "exchanged": [{"special": name, "general": NESTED[name]} for name in self.exchanged],
            "models": [
                models.of_base(self.base),
                models.of(self.starts[0], EVERY_EFFECT),
                *(models.of(one, f"without {one.out}") for one in self.path[1:]),
                models.of(chosen.fit, RETAINED, chosen.splines),
                models.mean([one for _, one in self.left_out], MEAN),
            ],
            "starts": [{"objective": one.objective / unit, **models.errors(one)} for one in self.starts],
            "bases": [self._base(one, models) for one in self.bases],
            "leave_one_out": [
                {"left_out": float(time[i]), "effects": sorted(one.active), **models.errors(one)}
                for i, one in self.left_out
            ],
            "unfinished_fits": sum(not one.converged for one in self.fits),
            "taken_out": [one.out for one in self.path[1:]],
        }

    def _base(self, one: Base, models: SheetModels) -> dict[str, Any]:
        return {
            "name": base_name(one.splines),
            "penalised_misfit": one.penalised_misfit - self.bases[0].penalised_misfit,
            "validation_error": one.validation_error,
            "chosen": one is self.chosen,
            **models.errors(one.fit, one.splines),
        }


def _without(problem: Problem, chosen: Base, name: str, unit: float, models: SheetModels, say: Say) -> dict[str, Any]:
    """What an effect is worth: everything else fitted again without it."""
    say(f"how much depends on {name}")
    whole = chosen.fit
    one = joint_fit.fit(with_splines(problem, chosen.splines), whole.c, whole.additions, whole.active - {name}, name)
    return {
        "effect": name,
        "rise": (one.loss - whole.loss) / unit,
        "penalty": whole.penalty([name]),
        "doubtful": elimination.bic_rise(whole, one, unit) < DEFAULT.equal_scores,
        "imitated": whole.imitated[name],
        "decided_by": BY_NAME[name].decided_by,
        **models.errors(one, chosen.splines),
    }


def verdict(one: Joint, good: bool) -> Verdict:
    """EXPLAINED only if what the model leaves is noise, and its prediction is `good`, see `predicts`."""
    p = float(stats.chi2.sf(one.loss, max(one.loss / one.dispersion, 1.0)))
    if p > DEFAULT.misfit_p and not one.active:
        return Verdict.NOTHING_SIGNIFICANT
    return Verdict.EXPLAINED if p > DEFAULT.misfit_p and good else Verdict.NOT_EXPLAINED


def predicts(before: dict[str, dict[str, float]], after: dict[str, dict[str, float]]) -> bool:
    """Whether neither force nor field is predicted worse than by the base: what fits to noise may still be wrong."""
    return all(after["scored"][kind] <= before["scored"][kind] for kind in ("force", "field"))


def rivals(e: Experiment, learnt: dict[str, Any], until: float, spacing: float, say: Say) -> list[dict[str, Any]]:
    """Softening with strain against relaxation in time: the retained effects, beside bases with more functions, without relaxation.

    On one ramp at one speed strain and time go together, so that both fit; what they predict differs.
    """
    split = Split.of(e, until)
    early = e.select(np.flatnonzero(split.fitted))
    (model,) = members(entry(learnt, RETAINED))
    problem, _ = prepared(early, np.ones(early.n_increments, bool), spacing)
    models = SheetModels(e, early, split, spacing, until, problem)
    kept = tuple(a for a in models.of_early(model.additions) if not isinstance(a.effect, Viscosity))
    found = []
    for n in (1, *SPLINES):
        say(f"{e.name}: {base_name(n)} that do not relax")
        one = joint_fit.fit(with_splines(problem, n), model.c, kept, frozenset(a.effect.name for a in kept))
        found.append(
            {
                "name": f"{base_name(n)}, not relaxing",
                "misfit": one.loss / learnt["dispersion"],
                **models.errors(one, n),
            }
        )
    return found


@dataclass(frozen=True)
class Base:
    """The retained effects beside a base of some functions of I1. penalised_misfit: misfit and penalty; validation_error: of force and
    field in the last part of the fitted increments, predicted from the rest."""

    splines: int
    fit: Joint
    penalised_misfit: float
    validation_error: dict[str, float]

    def validates(self, other: Base) -> bool:
        """Whether neither force nor field has a larger validation error than another."""
        return all(self.validation_error[kind] <= other.validation_error[kind] for kind in other.validation_error)


def _bases(problem: Problem, final: Joint, early: Experiment, unit: float, spacing: float, say: Say) -> list[Base]:
    """The same effects beside neo-Hooke and bases with more functions."""
    n = early.n_increments
    first = np.arange(n) < n - max(n // VALIDATION_PARTS, 1)
    short, _ = prepared(early, first, spacing)
    found = []
    for splines in (1, *SPLINES):
        say(f"base of {base_name(splines)}")
        fit = (
            joint_fit.fit(with_splines(problem, splines), final.c, final.additions, final.active)
            if splines > 1
            else final
        )
        seen = joint_fit.fit(with_splines(short, splines), fit.c, fit.additions, fit.active)
        r = short.parts[0].chain.residual(seen.c, seen.present)
        validation_error = force_and_field(short.parts[0].system, r, ~first)
        found.append(Base(splines, fit, penalised_misfit(splines, fit, unit), validation_error))
    return found
