"""`equigap predict`: uniaxial, equi-biaxial and pure-shear curves of a calibrated model.

In: a model file. Out: a table of nominal stress against stretch with 95 % bands where the model file holds an uncertainty,
a figure with the calibrated range marked, a report and a manifest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray

from calibrate.data.chosen_pictures import Wanted, chosen
from calibrate.data.experiment import Experiment
from calibrate.equations.deformation_modes import nominal_stress
from calibrate.models.compressible_sheet import sheet_stress
from calibrate.models.diagnosed_law import DiagnosedLaw
from calibrate.models.extended_model import ExtendedModel
from calibrate.models.model_file import load_model
from calibrate.models.network_model import Model
from studies.accuracy.metrics import MaterialDerivatives
from studies.commandline.option_types import (
    Assignments,
    Count,
    OutputFolder,
    Overwrite,
    Pictures,
    Positive,
    default_folder,
    within,
)
from studies.commandline.outcome import Outcome
from studies.commands.simulate import read_material
from studies.errors import OptionError
from studies.output import Manifest, open_output_folder
from studies.output.findings import Finding
from studies.reports.alert_table import alert_lines
from studies.reports.prediction.predicted_curves import Curve, findings
from studies.reports.prediction.predicted_curves import predict as predicted_curves
from studies.reports.prediction.predicted_forces import Forecast, forecast
from studies.reports.prediction.report import write_curves, write_forces

Array = NDArray[np.float64]
LARGEST = 20.0  # stretch
Stretch = Annotated[
    float, Parameter(validator=within(f"a stretch above 1 and at most {LARGEST:g}", lambda x: 1 < x <= LARGEST))
]


@Parameter(name="*", group="Curves")
@dataclass(frozen=True)
class CurveOptions:
    """Which curves, and what is drawn beside them."""

    stretch: Stretch | None = None
    """largest stretch (default: a quarter beyond the calibrated range)"""
    points: Count = 101
    """stretches a curve"""
    duration: Positive | None = None
    """s in which a pull at constant speed reaches the end of a curve, of a material that relaxes (default: infinitely slow)"""
    against: str | None = None
    """draw a known material beside it: arruda_boyce, neo_hooke, mooney_rivlin, yeoh (as `simulate`), or a model file"""
    parameter: Assignments = ()
    """of that material, such as mu=0.3; may be repeated"""


OfTheTest = Annotated[
    Pictures,
    Parameter(
        help="of --test that are used: all, how many, evenly spread, or numbers with commas between (default: all)"
    ),
]


@dataclass(frozen=True)
class PredictedCurves(Outcome):
    """Curves of the three homogeneous tests."""

    curves: tuple[Curve, ...]
    findings: tuple[Finding, ...]
    table: Path
    report: Path

    def lines(self) -> Iterable[str]:
        """Where the model extrapolates, and the files."""
        yield from alert_lines(self.findings)
        yield f"curves: {self.table}"
        yield f"report: {self.report}"


@dataclass(frozen=True)
class PredictedForces(Outcome):
    """Forces of another test."""

    forecast: Forecast
    table: Path
    report: Path

    def lines(self) -> Iterable[str]:
        """The error, what to know of it, and the files."""
        yield from alert_lines(self.forecast.findings)
        yield f"forces: {self.table}"
        yield f"report: {self.report}"


def predict(
    model: Path,
    /,
    *,
    test: Path | None = None,
    pictures: OfTheTest = None,
    curves: CurveOptions = CurveOptions(),
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> PredictedCurves | PredictedForces:
    """Predict the nominal stress (force over reference area) of uniaxial, equi-biaxial and pure-shear tests.

    In MPa, or in N/mm (stress times thickness) where the thickness of the calibrated sheet was unknown. What lies beyond the
    calibrated range is marked: there the model extrapolates. The table gives the standard deviation and a 95 % band of each
    stress. Of a model of `discover` the curves are those of its material, along both axes where it has fibres; its bands hold competing explanations, too. With --test: the forces of another test instead, from its measured displacements.

    Args:
        model: model file of `equigap calibrate` or `discover`
        test: predict the forces of this Experiment instead of curves

    Raises:
        ModelFileError: what is no model file.
        OptionError: options that do not go together.
        OutputFolderError: the folder holds another run.
    """
    if curves.parameter and not curves.against:
        raise OptionError("--parameter belongs to --against MATERIAL; name the material")
    if test is None:
        if pictures is not None:
            raise OptionError("--pictures belongs to --test; leave it out")
        return _curves(model, curves, output, overwrite)
    if curves != CurveOptions():
        raise OptionError(
            "--against, --stretch, --points and --duration belong to curves; leave them out where --test is given"
        )
    return _forces(model, test, curves, pictures, output, overwrite)


def _curves(file: Path, options: CurveOptions, output: Path | None, overwrite: bool) -> PredictedCurves:
    model = load_model(file)
    law = DiagnosedLaw(model, options.duration) if isinstance(model, ExtendedModel) else model
    if options.duration and not (isinstance(model, ExtendedModel) and model.relaxes):
        raise OptionError(f"--duration: {file} does not relax; leave it out")
    settings, compared = {"command": "predict", "test": None, **asdict(options)}, _compared_file(options)
    manifest = Manifest(settings=settings, inputs=[file, *([compared] if compared else [])])
    name = compared.name if compared else options.against
    key = {**settings, "against": name, "model": list(manifest.to_dict()["inputs"].values())}
    _check_units(file, model, options)
    curves = predicted_curves(law, options.stretch, options.points, _known_stress(options))
    folder = open_output_folder(output or default_folder("predict"), overwrite, key)
    report = write_curves(folder, law, curves, manifest, _known_name(options))
    return PredictedCurves(tuple(curves), tuple(findings(law, curves)), folder / "curves.csv", report)


def _forces(
    file: Path, test: Path, options: CurveOptions, pictures: Wanted, output: Path | None, overwrite: bool
) -> PredictedForces:
    found = forecast(file, chosen(Experiment.load(test), "all" if pictures is None else pictures))
    settings = {"command": "predict", "pictures": pictures, **asdict(options)}
    manifest = Manifest(settings=settings, inputs=[file, test])
    key = {"command": "predict", **settings, "inputs": list(manifest.to_dict()["inputs"].values())}
    folder = open_output_folder(output or default_folder("predict"), overwrite, key)
    return PredictedForces(found, folder / "forces.csv", write_forces(folder, found, manifest))


def _compared_file(options: CurveOptions) -> Path | None:
    """The model file to compare with; None where it is a known material, or nothing."""
    return Path(options.against) if options.against and options.against.endswith(".json") else None


def _check_units(file: Path, model: Model | ExtendedModel, options: CurveOptions) -> None:
    """Raises `OptionError` for a law in MPa beside a model in N/mm, or a model file in another unit."""
    if options.against is None or options.parameter:
        return
    compared = _compared_file(options)
    unit = load_model(compared).unit if compared else "MPa"
    if unit != model.unit:
        raise OptionError(
            f"--against {options.against}: its stresses are in {unit}, those of {file} in {model.unit}; give its parameters in {model.unit} with "
            "--parameter, or import the test with its thickness"
        )


def _known_name(options: CurveOptions) -> str | None:
    """The material to compare with and its parameters, which are the usual ones where none are given: 'neo-hooke (mu = 0.3)'."""
    if compared := _compared_file(options):
        return compared.name
    if options.against is None:
        return None
    values = read_material(options.against, dict(options.parameter)).to_dict()
    shown = ", ".join(f"{key} = {value:.4g}" for key, value in values.items() if key != "material")
    return f"{options.against.replace('_', '-')} ({shown})"


def _known_stress(options: CurveOptions) -> Callable[[str, Array, str], Array] | None:
    """Nominal stress (k,) in a mode at stretches (k,) along an axis of the material to compare with; of one with fibres along x, where the axis is none."""
    if options.against is None:
        return None
    if compared := _compared_file(options):
        if options.parameter:
            raise OptionError(f"--parameter does not apply to the model file {options.against}; leave it out")
        other = load_model(compared)
        if isinstance(other, Model):
            return lambda mode, x, axis: sheet_stress(other, mode, x)
        law = DiagnosedLaw(other, options.duration)
        return lambda mode, x, axis: law.homogeneous(mode, x, axis if axis in law.directions else law.directions[0])[1]
    slopes = MaterialDerivatives(read_material(options.against, dict(options.parameter)))
    return lambda mode, x, axis: nominal_stress(slopes, mode, x)
