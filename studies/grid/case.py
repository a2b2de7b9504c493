"""One case of a study: an Experiment and a loss in; the calibrated model and its agreement with the truth out.

A case's file holds a `CaseResult`: for every loss a `Fit`, judged against Arruda-Boyce inside and outside the calibrated
range of I1, and, where the study has a plane reference, at its deformation states. Stresses in MPa.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from calibrate.data.experiment import Experiment
from calibrate.effects.finite_thickness import of_the_mean
from calibrate.equations.deformation_modes import MODES, largest_stretch, nominal_stress
from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.virtual_fields import virtual_fields
from calibrate.fitting.calibrated_range import calibrated_range
from calibrate.fitting.calibration import Calibration, Options, calibrate
from studies.accuracy import metrics
from studies.accuracy.metrics import Agreement
from studies.accuracy.stress_error import Reference, StateErrors
from studies.grid.axes import Case, Loss, Settings

EXTRAPOLATION = 2.0  # curves and scores outside end where I1 - 3 is this many times the calibrated range
CURVE_POINTS = 121


@dataclass(frozen=True)
class Curve:
    """Nominal stress of the model and of the truth over stretch, all (k,); limit: stretch where the calibrated range ends."""

    stretch: list[float]
    limit: float
    truth: list[float]
    stress: list[float]


@dataclass(frozen=True)
class Fit:
    """A model calibrated with one loss. inside, outside: by mode, within the calibrated range and from there to
    `EXTRAPOLATION`. curves: by mode. states: errors at the states of the plane reference. seconds: of the calibration.

    summary: what `Calibration.summary` says; model: `Model.to_dict`.
    """

    inside: tuple[Agreement, ...]
    outside: tuple[Agreement, ...]
    seconds: float
    model: dict[str, Any]
    summary: dict[str, Any]
    curves: dict[str, Curve] | None = None
    states: StateErrors | None = None

    @property
    def force_error(self) -> float:
        """Relative error of the predicted forces."""
        return float(self.summary["relative_force_error"])

    @property
    def reduced_chi_square(self) -> float | None:
        """None for losses that do not state the noise."""
        return self.summary["reduced_chi_square"]

    def to_dict(self) -> dict[str, Any]:
        """Flat, for a file."""
        own = {name: value for name, value in asdict(self).items() if name not in ("summary", "states", "curves")}
        curves = {} if self.curves is None else {"curves": {mode: asdict(c) for mode, c in self.curves.items()}}
        return {**own, **curves, **self.summary, **({} if self.states is None else self.states.to_dict())}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Self:
        """Of what `to_dict` gave."""
        rest = dict(content)
        inside, outside = (tuple(Agreement(**score) for score in rest.pop(place)) for place in ("inside", "outside"))
        curves = rest.pop("curves", None)
        states = StateErrors.from_dict(rest) if "stress_error" in rest else None
        seconds, model = rest.pop("seconds"), rest.pop("model")
        summary = {name: value for name, value in rest.items() if name not in StateErrors.KEYS}
        found = None if curves is None else {mode: Curve(**curve) for mode, curve in curves.items()}
        return cls(inside, outside, seconds, model, summary, found, states)


@dataclass(frozen=True)
class CaseResult:
    """What is known of a case. calibrated_I1: up to which its models are judged as inside. failed: the named error that
    ended its calibration."""

    case: Case
    nodes: int
    triangles: int
    calibrated_I1: float
    losses: dict[Loss, Fit]
    failed: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """For a file."""
        own = {"nodes": self.nodes, "triangles": self.triangles, "calibrated_I1": self.calibrated_I1}
        fits = {str(loss): fit.to_dict() for loss, fit in self.losses.items()}
        return {**asdict(self.case), **own, "losses": fits, "failed": self.failed}

    @classmethod
    def load(cls, path: Path) -> Self:
        """Of a case's file. Raises `ValueError`, `KeyError`, `OSError`."""
        content = json.loads(path.read_text())
        case = Case(**{field.name: content[field.name] for field in fields(Case)})
        losses = {Loss(name): Fit.from_dict(fit) for name, fit in content["losses"].items()}
        return cls(case, content["nodes"], content["triangles"], content["calibrated_I1"], losses, content["failed"])


def calibrated_limit(experiment: Experiment) -> float:
    """Upper end of the calibrated range of I1 in an Experiment."""
    return calibrated_range(Equilibrium(experiment, virtual_fields(experiment)))["I1"][1]


def fit(
    experiment: Experiment, settings: Settings, loss: Loss, limit: float, reference: Reference | None = None
) -> Fit:
    """Calibrate with a loss and judge the model. limit: calibrated I1. reference: states at which it is judged as well."""
    polish = loss is Loss.POLISHED
    if loss is Loss.CORRECTED:
        experiment = of_the_mean(experiment)
    if loss in (Loss.CORRECTED, Loss.POLISHED):
        loss = Loss.WEIGHTED
    scaling = "dependent" if loss is Loss.DEPENDENT else "frozen"
    starts = 1 if loss is Loss.DEPENDENT else settings.starts
    options = Options(settings.inputs, settings.layers, "weighted" if loss is Loss.WEIGHTED else "paper", scaling, starts=starts)  # fmt: skip
    begin = time.perf_counter()
    result, more = _polished(calibrate(experiment, options)) if polish else (calibrate(experiment, options), {})
    seconds = time.perf_counter() - begin
    model = result.model
    states = None if reference is None else StateErrors.of(model, reference)
    found = judged(model, limit, seconds, {**result.summary(), **more}, states)
    return found if settings.keep_all else _shortened(found, model)


def _polished(result: Calibration) -> tuple[Calibration, dict[str, Any]]:
    """With what the polish did. Needs the finite-element package, which a study without it does not."""
    from studies.polish.polished_calibration import polished

    found, record = polished(result)
    return found, {"polish": record.to_dict()}


def judged(model: Any, limit: float, seconds: float, summary: dict[str, Any], states: StateErrors | None = None) -> Fit:
    """A model beside Arruda-Boyce, inside the calibrated range of I1, which ends at `limit`, and outside."""
    truth = metrics.ArrudaBoyceTruth()
    end = 3 + EXTRAPOLATION * (limit - 3)
    curves = {}
    for mode in MODES:
        stretch = np.linspace(1, largest_stretch(mode, end), CURVE_POINTS)
        expected, found = nominal_stress(truth, mode, stretch), model.homogeneous(mode, stretch)
        last = largest_stretch(mode, limit)
        curves[mode] = Curve(stretch.tolist(), last, expected.tolist(), np.asarray(found).tolist())
    inside = tuple(metrics.agreement(model, truth, limit))
    outside = tuple(metrics.agreement(model, truth, end, start=limit))
    return Fit(inside, outside, seconds, model.to_dict(), summary, curves, states)


def _shortened(fit: Fit, model: Any) -> Fit:
    """Without curves, covariance and starts, which are larger than all the rest."""
    summary = {name: value for name, value in fit.summary.items() if name != "losses_of_starts"}
    return replace(fit, curves=None, summary=summary, model=replace(model, uncertainty=None).to_dict())
