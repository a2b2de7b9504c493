"""What a measured sheet does beyond hyperelasticity: all effects fitted at once, and those that do not pay taken out.

In: an Experiment. Out: a dictionary of plain numbers with every model, its errors and what each effect is worth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from calibrate import effect_fit, effect_score, joint, whitened
from calibrate.chain import Addition
from calibrate.discovery import CLOSE, GLOBAL
from calibrate.effect_fit import Fit
from calibrate.effects import CATALOGUE, Effect, Parameter, SecondViscosity
from calibrate.effects.camera import OutOfPlane
from calibrate.effects.viscosity import Viscosity
from calibrate.effects.warp import InitialWarp, UnevenWarp
from calibrate.experiment import Experiment
from calibrate.extended import ExtendedModel, amplitude_unit, fingerprint
from calibrate.joint import Joint
from calibrate.whitened import Problem
from studies.measured_account import Split, account, equations

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Say = Callable[[str], None]
KNOWN = ("force offset", "lag between force and image")  # the record says: no force at rest, pictures in time to 0.15 s
ROUGH = ("3D effect of thickness", "subset smoothing")  # second derivatives, far below the virtual fields of 12 mm
RELAXATION = (0.5, 2.0, 8.0, 32.0)  # s, times of the branches tried
FASTEST = 0.5  # s: a third of the time between increments; what relaxes faster is told by its product g tau alone
NESTED = {"one fibre family": "two fibre families", "stiffness gradient": "stiffness field"}  # in the more general one
SPLINES = (2, 3, 5)  # of base models that are tried instead of neo-Hooke


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


def prepared(e: Experiment, fitted: Mask, spacing: float, splines: int = 1) -> tuple[Problem, Fit]:
    """Problem of the increments fitted (t,), whose base has a number of functions of I1, and its base fit."""
    problem, _ = effect_fit.prepare([e], [lambda system: equations(system, fitted)], spacing, base="positive")
    problem = with_splines(problem, splines)
    return problem, effect_fit.refit(problem, whitened.first_guess([problem.parts[0].assembled]), ())


def with_splines(problem: Problem, n: int) -> Problem:
    """The problem with a base energy of n functions of I1."""
    top = max(whitened.trained_top(part.system, part.train.rows) for part in problem.trained)
    start = whitened.first_guess([part.assembled for part in problem.trained])
    prior = whitened.smoothness("positive", n) / (effect_fit.STIFFENING * float(start.max()))
    return replace(problem, cone=whitened.base_cone(problem.basis, "positive", top, n), prior=prior, parametric=True)


def base_name(splines: int) -> str:
    """'neo-Hooke' or how many splines."""
    return "neo-Hooke" if splines == 1 else f"{splines} splines"


def learn(e: Experiment, until: float, spacing: float, say: Say) -> dict[str, Any]:
    """What is beyond neo-Hooke in the increments up to `until`, with errors after it; everything that the report shows.

    All candidates are fitted at once, from several starts; those that do not pay are taken out (`calibrate.joint`); a general
    effect gives way to a special one, and neo-Hooke to a finer base, where that pays.
    """
    split = Split.of(e, until)
    say(f"{e.name}: base model")
    early = e.select(np.flatnonzero(split.fitted))
    problem, base = prepared(early, np.ones(early.n_increments, bool), spacing)
    scores = effect_score.score(problem, base, EFFECTS)
    start = joint.candidates(scores, tuple(NESTED))
    say(f"{e.name}: all {len(start)} effects")
    starts = joint.whole(problem, base.c, start)
    path = joint.reduced(problem, starts[0], lambda text: say(f"{e.name}: {text}"))
    unit = starts[0].dispersion
    final, exchanged = specialised(problem, path[-1], unit, lambda text: say(f"{e.name}: {text}"))
    models = _Models(e, early, split, spacing, until, problem)
    bases = [(1, final), *_finer(problem, final, lambda text: say(f"{e.name}: {text}"))]
    splines, chosen = min(bases, key=lambda pair: _price(pair[0], pair[1], unit))
    result: dict[str, Any] = {
        "name": e.name,
        "spacing": spacing,
        "time": e.time,
        "split": {name: np.flatnonzero(mask).tolist() for name, mask in split.parts().items()},
        "dispersion": unit,
        "equations": starts[0].n_rows,
        "exchanged": [{"special": special, "general": general} for special, general in exchanged],
        "models": [
            models.of_base(base),
            models.of(starts[0], "every effect"),
            *(models.of(one, f"without {one.out}") for one in path[1:]),
        ],
        "starts": [{"objective": one.objective / unit, **models.errors(one)} for one in starts],
        "bases": [
            {"name": base_name(n), "price": _price(n, one, unit) - _price(1, final, unit), **models.errors(one, n)}
            for n, one in bases
        ],
    }
    last = models.of(chosen, "what pays", splines)
    result["models"].append(last)
    result["predicts"] = predicts(result["models"][0]["errors"], last["errors"])
    result["verdict"] = last["model"]["verdict"] = verdict(chosen, result["predicts"])
    result["without"] = []
    for name in sorted(chosen.active):
        say(f"{e.name}: how much depends on {name}")
        one = joint.fit(with_splines(problem, splines), chosen.c, chosen.additions, chosen.active - {name}, name)
        worth = joint.worth(chosen, one, unit)
        result["without"].append(
            {
                "effect": name,
                "rise": (one.loss - chosen.loss) / unit,
                "price": chosen.price([name]),
                "doubtful": worth < CLOSE,
                "imitated": chosen.imitated[name],
                "decided_by": BY_NAME[name].decided_by,
                **models.errors(one, splines),
            }
        )
    fits = [*starts, *path, final, *(one for _, one in bases)]
    result["unfinished_fits"] = sum(not one.converged for one in fits)
    result["closest"] = [line["effect"] for line in sorted(result["without"], key=lambda line: -line["rise"])]
    result["taken_out"] = [one.out for one in path[1:]]
    result["not_testable"] = {s.effect.name: s.why for s in scores if s.status != "tested"}
    return result


def verdict(one: Joint, good: bool) -> str:
    """'explained' only if what the model leaves is noise, and its prediction is `good`, see `predicts`."""
    p = float(stats.chi2.sf(one.loss, max(one.loss / one.dispersion, 1.0)))
    if p > GLOBAL and not one.active:
        return "nothing significant"
    return "explained" if p > GLOBAL and good else "significant, not explained"


def predicts(before: dict[str, dict[str, float]], after: dict[str, dict[str, float]]) -> bool:
    """Whether neither force nor field is predicted worse than by the base: what fits to noise may still be wrong."""
    return all(after["scored"][kind] <= before["scored"][kind] for kind in ("force", "field"))


def rivals(e: Experiment, learnt: dict[str, Any], until: float, spacing: float, say: Say) -> list[dict[str, Any]]:
    """Softening with strain against relaxation in time: what pays, beside bases with more functions, without relaxation.

    On one ramp at one speed strain and time go together, so that both fit; what they predict differs.
    """
    split = Split.of(e, until)
    early = e.select(np.flatnonzero(split.fitted))
    model = ExtendedModel.from_dict(learnt["models"][-1]["model"])
    problem, _ = prepared(early, np.ones(early.n_increments, bool), spacing)
    models = _Models(e, early, split, spacing, until, problem)
    kept = tuple(a for a in models.of_early(model.additions) if not isinstance(a.effect, Viscosity))
    found = []
    for n in (1, *SPLINES):
        say(f"{e.name}: {base_name(n)} that do not relax")
        one = joint.fit(with_splines(problem, n), model.c, kept, frozenset(a.effect.name for a in kept))
        found.append(
            {
                "name": f"{base_name(n)}, not relaxing",
                "misfit": one.loss / learnt["dispersion"],
                **models.errors(one, n),
            }
        )
    return found


def _price(n: int, one: Joint, unit: float) -> float:
    """Misfit over dispersion and price of the functions of the base and the parameters of the effects."""
    return one.loss / unit + (n + sum(map(joint.n_parameters, one.present))) * float(np.log(one.n_rows))


def specialised(problem: Problem, now: Joint, unit: float, say: Say) -> tuple[Joint, list[tuple[str, str]]]:
    """The fit with special effects in the place of general ones that are no better, and each special one with its general."""
    exchanged: list[tuple[str, str]] = []
    for special, general in NESTED.items():
        if general not in now.active:
            continue
        say(f"{special} instead of {general}")
        effect = BY_NAME[special]
        best = None
        for shape in _special_shapes(next(a for a in now.additions if a.effect.name == general), effect):
            values = tuple(p.null + (0.3 * p.typical if shape else 0.0) for p in effect.amplitudes)
            others = tuple(a for a in now.additions if a.effect.name != general)
            one = joint.fit(
                problem, now.c, (Addition(effect, values, shape), *others), now.active - {general} | {special}
            )
            best = one if best is None or one.objective < best.objective else best
        if best is not None and _price(1, best, unit) < _price(1, now, unit):
            now = best
            exchanged.append((special, general))
    return now, exchanged


def _special_shapes(general: Addition, special: Effect) -> list[tuple[float, ...]]:
    """Where a special effect is started: one family of fibres along either of two, and between them."""
    if not special.shapes:
        return [()]
    axis, half = general.shape
    return [(axis - half,), (axis,), (axis + half,)] if half > 0.05 else [(axis,)]


def _finer(problem: Problem, final: Joint, say: Say) -> list[tuple[int, Joint]]:
    """The same effects beside bases with more functions."""
    found = []
    for n in SPLINES:
        say(f"base of {n} splines")
        found.append((n, joint.fit(with_splines(problem, n), final.c, final.additions, final.active)))
    return found


@dataclass(frozen=True)
class _Models:
    """Joint fits as model files, with their errors on the whole sheet."""

    whole: Experiment
    early: Experiment
    split: Split
    spacing: float
    until: float
    problem: Problem

    def extended(self, one: Joint) -> ExtendedModel:
        """The model file; an amplitude that is a share of the whole loading holds for all increments."""
        present, deviations = list(one.present), list(one.errors)
        for i, a in enumerate(present):
            if a.effect.name == OutOfPlane.name:
                present[i] = replace(a, amplitudes=(self.growth * a.amplitudes[0],))
                deviations[i] = (self.growth * deviations[i][0],)
        return self._model(one.c, present, deviations)

    @property
    def growth(self) -> float:
        """Displacements of the whole loading over those of what was fitted."""
        both = (np.sqrt((e.displacements**2).mean(axis=(1, 2))).max() for e in (self.whole, self.early))
        return float(next(both) / next(both))

    def of_early(self, additions: Sequence[Addition]) -> tuple[Addition, ...]:
        """Additions of a model file as they are in a fit of the increments up to the limit."""
        return tuple(
            replace(a, amplitudes=(a.amplitudes[0] / self.growth,)) if a.effect.name == OutOfPlane.name else a
            for a in additions
        )

    def _model(self, c: Array, additions: Sequence[Addition], deviations: Sequence[tuple[float, ...]]) -> ExtendedModel:
        e = self.whole
        training = ({"name": e.name, "fingerprint": fingerprint(e)},)
        held = f"increments after {self.until:g} s"
        basis = self.problem.basis
        return ExtendedModel(basis, c, tuple(additions), tuple(deviations), e.stress_unit, training, held)

    def errors(self, one: Joint, splines: int = 1) -> dict[str, Any]:
        """Errors of force and field on what was fitted and scored."""
        found = self.of(one, "", splines)["errors"]
        return {f"{kind}_{part}": found[part][kind] for part in found for kind in ("force", "field")}

    def of(self, one: Joint, name: str, splines: int = 1) -> dict[str, Any]:
        """A model with everything that the report shows of it."""
        return self._described(self.extended(one), name, splines, one.loss / one.n_rows, one.dispersion)

    def of_base(self, fit: Fit) -> dict[str, Any]:
        """Neo-Hooke alone."""
        model = self._model(fit.c, (), ())
        return self._described(model, "neo-Hooke", 1, fit.loss / fit.n_rows, fit.loss / (fit.n_rows - 1))

    def _described(
        self, model: ExtendedModel, name: str, splines: int, chi_square: float, reduced: float
    ) -> dict[str, Any]:
        return {
            "name": name,
            "base": base_name(splines),
            "effects": [a.effect.name for a in model.additions],
            "chi_square": chi_square,
            "reduced_chi_square": reduced,
            "amplitudes": [
                {
                    "effect": a.effect.name,
                    "name": p.name,
                    "unit": amplitude_unit(p, model.unit),
                    "value": v,
                    "deviation": d,
                }
                for a, deviations in zip(model.additions, model.errors, strict=True)
                for p, v, d in zip(a.effect.amplitudes, a.amplitudes, deviations, strict=True)
            ],
            "shapes": [
                {"effect": a.effect.name, "name": p.name, "unit": amplitude_unit(p, model.unit), "value": v}
                for a in model.additions
                for p, v in zip(a.effect.shapes, a.shape, strict=True)
            ],
            "model": model.to_dict(),
            **account(self.whole, model, self.split, self.spacing),
        }
