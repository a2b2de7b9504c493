"""What a measured sheet does beyond hyperelasticity: all effects fitted at once, and those that BIC does not retain removed.

In: an Experiment. Out: `SheetResult` with every model, its errors and what each effect is worth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from calibrate.data.experiment import Experiment
from calibrate.diagnosis import score_tests
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.joint import elimination
from calibrate.diagnosis.joint import fit as joint_fit
from calibrate.diagnosis.joint.everything import NESTED, simple_base
from calibrate.diagnosis.joint.fit import Joint
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.selection import DEFAULT, Verdict
from calibrate.effects import CATALOGUE, Effect, Parameter, SecondViscosity
from calibrate.effects.chain import Addition
from calibrate.effects.viscosity import Viscosity
from calibrate.effects.warp import InitialWarp, UnevenWarp
from studies.reports.discovery.candidate_outcome import untested_words
from studies.sheets.leave_one_out import leave_one_out_fits, penalised_misfit, prepared, retain
from studies.sheets.measured_results import Rival, RivalResult
from studies.sheets.model_errors import Split, force_and_field
from studies.sheets.sheet_models import SheetModels, base_name
from studies.sheets.sheet_results import (
    BaseResult,
    EffectWorth,
    ErrorsOfParts,
    Exchange,
    FittedModel,
    ForceAndField,
    Increments,
    LeftOut,
    ModelName,
    SheetResult,
    Start,
    model_of,
)

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


def learn(e: Experiment, until: float, spacing: float, say: Say) -> SheetResult:
    """What is beyond neo-Hooke in the increments up to `until`, with errors after it; everything that the report shows.

    All candidates are fitted at once, from several starts; those that BIC does not retain are removed (`calibrate.diagnosis.joint.fit`); a general
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
    fits = _fits(problem, base, elimination.candidates(scores, tuple(NESTED)), early, spacing, tell)
    models = SheetModels(e, early, split, spacing, until, problem)
    untested = {s.effect.name: untested_words(s) for s in scores if not s.is_tested}
    return _result(fits, models, untested, tell)


def _fits(
    problem: Problem, base: Fit, start: tuple[Addition, ...], early: Experiment, spacing: float, tell: Say
) -> _Fits:
    special = {name: BY_NAME[name] for name in NESTED if name in BY_NAME}
    tell(f"all {len(start)} effects")
    starts = elimination.fits_of_all(problem, base.c, start)
    path, reduced, exchanged = retain(problem, starts[0], special, tell)
    bases = _bases(problem, reduced, early, starts[0].dispersion, spacing, tell)
    chosen = min((one for one in bases if one.validates(bases[0])), key=lambda one: one.penalised_misfit)
    left_out = list(leave_one_out_fits(early, starts[0], special, spacing, tell))
    return _Fits(base, starts, path, exchanged, bases, chosen, left_out)


def _result(fits: _Fits, models: SheetModels, untested: dict[str, str], tell: Say) -> SheetResult:
    e, split, chosen, unit = models.whole, models.split, fits.chosen, fits.starts[0].dispersion
    assert e.time is not None
    time = e.time[split.fitted]
    described = fits.models(models)
    first, retained, mean = (
        model_of(described, name).errors for name in (ModelName.BASE, ModelName.RETAINED, ModelName.MEAN)
    )
    good = predicts(first, retained) and predicts(first, mean)
    answer = verdict(chosen.fit, good)
    without = [_without(chosen, name, unit, models, tell) for name in sorted(chosen.fit.active)]
    return SheetResult(
        name=e.name,
        spacing=models.spacing,
        time=e.time.tolist(),
        split=Increments(**{name: np.flatnonzero(mask).tolist() for name, mask in split.parts().items()}),
        not_testable=untested,
        dispersion=unit,
        equations=fits.starts[0].n_rows,
        exchanged=[Exchange(name, NESTED[name]) for name in fits.exchanged],
        models=[with_verdict(one, answer) for one in described],
        starts=[Start(objective=one.objective / unit, **models.errors(one)) for one in fits.starts],
        bases=[fits.base_result(one, models) for one in fits.bases],
        leave_one_out=[
            LeftOut(left_out=float(time[i]), effects=sorted(one.active), **models.errors(one))
            for i, one in fits.left_out
        ],
        unfinished_fits=sum(not one.converged for one in fits.all),
        taken_out=[one.out for one in fits.path if one.out is not None],
        predicts=good,
        verdict=answer,
        without=without,
        closest=[line.effect for line in sorted(without, key=lambda line: -line.rise)],
    )


@dataclass(frozen=True)
class _Fits:
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
    def all(self) -> list[Joint]:
        """Every fit that may have stopped early."""
        return [*self.starts, *self.path, *(one.fit for one in self.bases), *(one for _, one in self.left_out)]

    def models(self, models: SheetModels) -> list[FittedModel]:
        """The base, every effect, the path, what is retained, and the mean."""
        return [
            models.of_base(self.base),
            models.of(self.starts[0], ModelName.EVERY_EFFECT),
            *(models.of(one, f"without {one.out}") for one in self.path[1:]),
            models.of(self.chosen.fit, ModelName.RETAINED, self.chosen.splines),
            models.mean([one for _, one in self.left_out], ModelName.MEAN),
        ]

    def base_result(self, one: Base, models: SheetModels) -> BaseResult:
        """One of the bases with its errors."""
        return BaseResult(
            name=base_name(one.splines),
            penalised_misfit=one.penalised_misfit - self.bases[0].penalised_misfit,
            validation_error=one.validation_error,
            chosen=one is self.chosen,
            **models.errors(one.fit),
        )


def with_verdict(model: FittedModel, answer: Verdict) -> FittedModel:
    """The model with the verdict in its files, where it is a result."""
    if model.name not in (ModelName.RETAINED, ModelName.MEAN):
        return model
    return replace(model, members=[{**member, "verdict": str(answer)} for member in model.members])


def _without(chosen: Base, name: str, unit: float, models: SheetModels, say: Say) -> EffectWorth:
    """What an effect is worth: everything else fitted again without it."""
    say(f"how much depends on {name}")
    whole = chosen.fit
    one = joint_fit.fit(
        simple_base(models.problem, chosen.splines), whole.c, whole.additions, whole.active - {name}, name
    )
    return EffectWorth(
        effect=name,
        rise=(one.loss - whole.loss) / unit,
        penalty=whole.penalty([name]),
        doubtful=bool(elimination.bic_rise(whole, one, unit) < DEFAULT.equal_scores),
        imitated=float(whole.imitated[name]),
        decided_by=BY_NAME[name].decided_by,
        **models.errors(one),
    )


def verdict(one: Joint, good: bool) -> Verdict:
    """EXPLAINED only if what the model leaves is noise, and its prediction is `good`, see `predicts`."""
    p = float(stats.chi2.sf(one.loss, max(one.loss / one.dispersion, 1.0)))
    if p > DEFAULT.misfit_p and not one.active:
        return Verdict.NOTHING_SIGNIFICANT
    return Verdict.EXPLAINED if p > DEFAULT.misfit_p and good else Verdict.NOT_EXPLAINED


def predicts(before: ErrorsOfParts, after: ErrorsOfParts) -> bool:
    """Whether neither force nor field is predicted worse than by the base: what fits to noise may still be wrong."""
    return after.scored.is_no_larger_than(before.scored)


def rivals(e: Experiment, learnt: SheetResult, until: float, spacing: float, say: Say) -> RivalResult:
    """Softening with strain against relaxation in time: the retained effects, beside bases with more functions, without relaxation.

    On one ramp at one speed strain and time go together, so that both fit; what they predict differs.
    """
    split = Split.of(e, until)
    early = e.select(np.flatnonzero(split.fitted))
    (model,) = learnt.model(ModelName.RETAINED).models
    problem, _ = prepared(early, np.ones(early.n_increments, bool), spacing)
    models = SheetModels(e, early, split, spacing, until, problem)
    kept = tuple(a for a in models.of_early(model.additions) if not isinstance(a.effect, Viscosity))
    found = []
    for n in (1, *SPLINES):
        say(f"{e.name}: {base_name(n)} that do not relax")
        one = joint_fit.fit(simple_base(problem, n), model.c, kept, frozenset(a.effect.name for a in kept))
        misfit = one.loss / learnt.dispersion
        found.append(Rival(name=f"{base_name(n)}, not relaxing", misfit=misfit, **models.errors(one)))
    return RivalResult(found)


@dataclass(frozen=True)
class Base:
    """The retained effects beside a base of some functions of I1. penalised_misfit: misfit and penalty; validation_error: of force and
    field in the last part of the fitted increments, predicted from the rest."""

    splines: int
    fit: Joint
    penalised_misfit: float
    validation_error: ForceAndField

    def validates(self, other: Base) -> bool:
        """Whether neither force nor field has a larger validation error than another."""
        return self.validation_error.is_no_larger_than(other.validation_error)


def _bases(problem: Problem, final: Joint, early: Experiment, unit: float, spacing: float, say: Say) -> list[Base]:
    """The same effects beside neo-Hooke and bases with more functions."""
    n = early.n_increments
    first = np.arange(n) < n - max(n // VALIDATION_PARTS, 1)
    short, _ = prepared(early, first, spacing)
    found = []
    for splines in (1, *SPLINES):
        say(f"base of {base_name(splines)}")
        fit = (
            joint_fit.fit(simple_base(problem, splines), final.c, final.additions, final.active)
            if splines > 1
            else final
        )
        seen = joint_fit.fit(simple_base(short, splines), fit.c, fit.additions, fit.active)
        r = short.parts[0].chain.residual(seen.c, seen.present)
        validation_error = force_and_field(short.parts[0].system, r, ~first)
        found.append(Base(splines, fit, penalised_misfit(splines, fit, unit), validation_error))
    return found
