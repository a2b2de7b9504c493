"""`equigap predict --test`: the forces of another test, from its measured displacements.

In: a model file of `equigap calibrate` or `equigap discover`, and an Experiment. Out: forces measured and predicted, their
relative error, a figure, a report and a manifest.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.equations.equilibrium import equilibrium
from calibrate.equations.kinematics import invariants_and_derivatives
from calibrate.errors import ConfigError
from calibrate.fitting.calibration import predict_forces, relative_force_error
from calibrate.models.extended_model import ExtendedModel
from calibrate.models.model_file import load_model
from studies.commands.options import output_folder, settings
from studies.output import style
from studies.reports import force_record

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Forecast:
    """What a model says of a test. forces: {boundary: (t, 2)} N, predicted. outside: share of area and increments beyond the
    calibrated range. model: in words. left_out: effects of other tests, which do not hold here."""

    experiment: Experiment
    forces: dict[str, Array]
    outside: float
    model: str
    left_out: tuple[str, ...] = ()
    unused_bulk_modulus: float | None = None

    @property
    def measured(self) -> dict[str, Array]:
        """{boundary: (t, 2)} N."""
        return {b.name: b.force for b in self.experiment.loaded}

    @property
    def error(self) -> float:
        """Norm of the force errors over that of the measured forces."""
        return relative_force_error(self.forces, self.measured)

    @property
    def remarks(self) -> list[str]:
        """What a reader of the error should know."""
        lines = [f"relative force error of {self.experiment.name}: {100 * self.error:.3g} %"]
        if self.outside > 0:
            lines.append(
                f"{100 * self.outside:.2g} % of the specimen, over all increments, lies beyond the calibrated range: there "
                "the model extrapolates"
            )
        if self.unused_bulk_modulus is not None:
            lines.append(
                f"the test is in plane stress, where the material is taken for incompressible: the bulk modulus of the model "
                f"({self.unused_bulk_modulus:.4g} {self.experiment.stress_unit}) is not used"
            )
        if self.left_out:
            lines.append(f"left out, because they belong to the tests that were fitted: {', '.join(self.left_out)}")
        return lines


def forecast(path: Path, experiment: Experiment) -> Forecast:
    """Raises `ModelFileError`, `ConfigError` where units or times do not go together."""
    model = load_model(path)
    if isinstance(model, ExtendedModel):
        found = model.predict(experiment)
        kept = [a.effect.name for a in model.for_test(experiment)]
        name = " + ".join(["I1 energy", *kept])
        return Forecast(experiment, found.forces, found.outside, name, found.left_out)
    if experiment.stress_unit != model.unit:
        raise ConfigError(
            f"{experiment.name}: its stresses are in {experiment.stress_unit}, the model's in {model.unit}; give the "
            "thickness to both, or to none"
        )
    system = equilibrium(experiment)
    forces, _ = predict_forces(system, model)
    values = np.asarray(invariants_and_derivatives(system.isochoric_gradients)[0])
    beyond = ~model.in_range(values) & (values[..., 0] > 3 + 1e-3)  # what is hardly deformed is no extrapolation
    outside = float((system.areas * beyond).sum() / (system.areas.sum() * len(values)))
    unused = model.bulk_modulus if experiment.plane == "stress" else None
    name = f"PANN of {model.architecture.inputs}"
    return Forecast(experiment, forces, outside, name, unused_bulk_modulus=unused)


def main(args: argparse.Namespace) -> int:
    """Write table, figure, report and manifest."""
    from studies.output import Manifest, open_output_folder, write_csv, write_figure
    from studies.output.report import Report

    found = forecast(args.model, Experiment.load(args.test))
    manifest = Manifest(settings=settings(args, "model", "test"), inputs=[args.model, args.test])
    key = {**settings(args, "model", "test"), "inputs": list(manifest.to_dict()["inputs"].values())}
    folder = open_output_folder(output_folder(args, "predict"), args.overwrite, key)
    table, picture = folder / "forces.csv", folder / "forces.png"
    columns, rows = force_record.rows(found.measured, found.forces, found.experiment.time)
    write_csv(table, columns, rows, ["forces of the grip on the specimen, N; time in s"])
    write_figure(picture, draw(found))
    manifest.beside(picture, table, relative_force_error=found.error, outside=found.outside)
    report = Report(f"Prediction of {found.experiment.name}", found.model)
    report.figure(
        picture, "Forces measured (circles) and predicted from the measured displacements (lines); differences below."
    )
    for line in found.remarks:
        report.paragraph(line[0].upper() + line[1:] + ".")
        print(f"- {line}")
    report.table(columns, rows, "Forces of the grip on the specimen, N.")
    report.details("Versions", manifest.to_dict()["versions"])
    print(f"forces: {table}\nreport: {report.save(folder / 'report.html')}")
    return 0


def draw(found: Forecast) -> Any:
    """Forces over time or increments, differences below; components that carry next to nothing are left out."""
    panels = force_record.worth_drawing(found.measured)
    time = found.experiment.time
    x = np.arange(1.0, found.experiment.n_increments + 1) if time is None else time
    with style.figure(max(4.8, 3.0 * len(panels)), 4.4) as figure:
        axes = figure.subplots(2, len(panels), squeeze=False, sharex=True, height_ratios=(2, 1.2))
        for (top, bottom), (name, k) in zip(axes.T, panels, strict=True):
            measured, predicted = found.measured[name][:, k], found.forces[name][:, k]
            top.plot(x, measured, "o", color="black", mfc="none", label="measured")
            top.plot(x, predicted, color=style.COLOURS["blue"], label="predicted")
            bottom.plot(x, predicted - measured, ".-", color=style.COLOURS["blue"])
            bottom.axhline(0, color="0.4", lw=0.6)
            top.set_title(f"{name} edge, {force_record.COMPONENTS[k]}")
            bottom.set_xlabel("increment" if time is None else "time, s")
        axes[0, 0].set_ylabel("force on the specimen, N")
        axes[1, 0].set_ylabel("predicted - measured, N")
        axes[0, 0].legend()
        return figure
