"""The forces of another test, from its measured displacements.

In: a model file of `equigap calibrate` or `equigap discover`, and an Experiment. Out: `Forecast`, forces measured and
predicted with their relative error.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.equations.equilibrium import equilibrium
from calibrate.equations.kinematics import invariants_and_derivatives
from calibrate.errors import ConfigError
from calibrate.fitting.calibration import predict_forces, relative_force_error
from calibrate.models.extended_model import ExtendedModel
from calibrate.models.model_file import load_model
from calibrate.models.network_model import Model
from studies.output.findings import Finding, Macro
from studies.reports.experiments.experiment_findings import pictures
from studies.reports.model_remarks import model_remarks

Array = NDArray[np.float64]
ANOTHER = 0.5  # relative force error, above which model and test have other units, or are of other materials
UNDEFORMED = 1e-3  # of I1 - 3, below which a triangle is no extrapolation


class Remark(Macro):
    """What a reader of the error should know; macros of ``templates/prediction.txt``."""

    ERROR = "force_error"
    ONE_FACTOR = "one_factor"
    OUTSIDE = "outside_range"
    BULK_MODULUS = "bulk_modulus_unused"
    LEFT_OUT = "effects_left_out"
    WITHOUT_TWIN = "effects_without_twin"


@dataclass(frozen=True)
class Forecast:
    """What a model says of a test. forces: {boundary: (t, 2)} N, predicted. outside: share of area and increments beyond the
    calibrated range. model: its name. left_out: effects of other tests, which do not hold here; without_twin: those that hold and lack what a replay told the fit. factor: by which the forces are
    multiplied for the error, None where the levels of model and test are known; nominal_model: whether that of the model is not. remarks: on the
    model itself."""

    experiment: Experiment
    forces: dict[str, Array]
    outside: float
    model: str
    left_out: tuple[str, ...] = ()
    without_twin: tuple[str, ...] = ()
    unused_bulk_modulus: float | None = None
    factor: float | None = None
    nominal_model: bool = False
    remarks: tuple[Finding, ...] = ()

    @property
    def measured(self) -> dict[str, Array]:
        """{boundary: (t, 2)} N."""
        return {b.name: b.force for b in self.experiment.loaded}

    @property
    def error(self) -> float:
        """Norm of the force errors over that of the measured forces; where a level is nominal, at the factor that fits best."""
        factor = 1.0 if self.factor is None else self.factor
        return relative_force_error({name: factor * force for name, force in self.forces.items()}, self.measured)

    @property
    def findings(self) -> list[Finding]:
        """What a reader of the error should know."""
        e = self.experiment
        error = {"name": e.name, "relative_force_error": self.error}
        found: list[tuple[Remark, dict[str, object]]] = []
        if self.factor is not None:
            found.append((Remark.ONE_FACTOR, {"factor": self.factor, "of_model": self.nominal_model}))
        if self.outside > 0:
            found.append((Remark.OUTSIDE, {"share": self.outside}))
        if self.unused_bulk_modulus is not None:
            found.append((Remark.BULK_MODULUS, {"bulk_modulus": self.unused_bulk_modulus, "unit": e.stress_unit}))
        if self.left_out:
            found.append((Remark.LEFT_OUT, {"effects": list(self.left_out)}))
        if self.without_twin:
            found.append((Remark.WITHOUT_TWIN, {"effects": list(self.without_twin)}))
        first = Finding("prediction", Remark.ERROR, error, self.error > ANOTHER)
        return [*self.remarks, *pictures(e), first, *(Finding("prediction", code, data) for code, data in found)]


def forecast(path: Path, experiment: Experiment) -> Forecast:
    """Raises `ModelFileError`, `ConfigError` where units or times do not go together.

    Where the level of model or test is nominal, the error is that of all forces times the factor that fits the recorded ones best.
    """
    model = load_model(path)
    found = replace(_forecast(model, experiment), remarks=tuple(model_remarks(model)))
    if not (model.level_is_nominal or experiment.level_is_nominal):
        return found
    factor = _best_factor(found.forces, found.measured)
    return replace(found, factor=factor, nominal_model=model.level_is_nominal)


def _best_factor(predicted: dict[str, Array], measured: dict[str, Array]) -> float:
    """Least squares over every measured component."""
    a, b = (np.concatenate([forces[name].ravel() for name in predicted]) for forces in (predicted, measured))
    known = np.isfinite(b)
    return float(a[known] @ b[known] / max(a[known] @ a[known], 1e-300))


def _forecast(model: Model | ExtendedModel, experiment: Experiment) -> Forecast:
    """At the level of the model."""
    if isinstance(model, ExtendedModel):
        found = model.predict(experiment)
        kept = [a.effect for a in model.for_test(experiment)]
        name = " + ".join(["I1 energy", *(effect.name for effect in kept)])
        without_twin = tuple(effect.name for effect in kept if effect.reads_twin)
        return Forecast(experiment, found.forces, found.outside, name, found.left_out, without_twin)
    if experiment.stress_unit != model.unit:
        raise ConfigError(
            f"{experiment.name}: its stresses are in {experiment.stress_unit}, the model's in {model.unit}; give the "
            "thickness to both, or to none"
        )
    system = equilibrium(experiment)
    forces, _ = predict_forces(system, model)
    values = np.asarray(invariants_and_derivatives(system.isochoric_gradients)[0])
    beyond = ~model.in_range(values) & (values[..., 0] > 3 + UNDEFORMED)
    outside = float((system.areas * beyond).sum() / (system.areas.sum() * len(values)))
    unused = model.bulk_modulus if experiment.plane == "stress" else None
    name = f"network of {model.architecture.inputs}"
    return Forecast(experiment, forces, outside, name, unused_bulk_modulus=unused)
