"""`equigap calibrate`: an Experiment in, a model with its evidence out.

Out: ``model.json`` (read by `equigap predict` and by the forward models), ``report.html``, its figures as PNG, a
table of forces ``forces.csv``, and a manifest with every setting and result.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray

from calibrate.data.chosen_pictures import chosen
from calibrate.data.experiment import Experiment
from calibrate.diagnosis.hold_out import HoldOut, Kind
from calibrate.errors import ConfigError
from calibrate.fitting.calibration import Calibration, Options
from calibrate.fitting.calibration import calibrate as fit_network
from calibrate.fitting.classical_fit import compare
from calibrate.fitting.noise.noise_check import with_found_noise
from studies.commandline.option_types import (
    Count,
    Integers,
    OutputFolder,
    Overwrite,
    Pictures,
    Positive,
    Seed,
    default_folder,
)
from studies.commandline.outcome import Complete, Outcome
from studies.importers import homogeneous_curves
from studies.importers.curve_file import read_curves
from studies.output import Manifest, callback, open_output_folder, released_if_refused
from studies.output.folder import complete, earlier_answer
from studies.reports.calibration.fit_review import Review, review
from studies.reports.calibration.polish_record import PolishRecord
from studies.reports.calibration.report import summary_lines, write
from studies.reports.supervised import curve_calibration
from studies.reports.supervised.curve_calibration import CurveCalibration

QUICK_STARTS, QUICK_PICTURES = 4, 6
TABLES = (".csv", ".txt", ".tsv", ".dat")


@Parameter(name="*", group="Model and fit")
@dataclass(frozen=True)
class Fit:
    """The network, and how it is fitted."""

    inputs: Literal["I1", "I2", "I1I2"] = "I1"
    """invariants"""
    layers: Integers = (4, 4)
    """neurons of each layer"""
    loss: Literal["weighted", "paper"] = "weighted"
    """weighted by the noise on coarse virtual fields, or the plain equilibrium gap"""
    scaling: Literal["frozen", "dependent"] = "frozen"
    """of --loss paper: scale of the nodal forces held, or following the model"""
    spacing: Positive | None = None
    """of the virtual fields, mm (default: from the noise)"""
    starts: Count = 20
    """random starts"""
    seed: Seed = 0
    """of the random starts"""
    polish: bool = False
    """then fit the network to all displacements and forces of the test, solved by finite elements (docs/replay.md)"""
    hold_out: str | None = None
    """leave increments out of the fit and score the model on them: last[:SHARE], random[:SHARE] (a share of them, 0.3 where it is not
    given), every:N (each N-th), after:SECONDS"""

    def options(self, quick: bool) -> Options:
        """As `calibrate` takes them. Raises `ConfigError`."""
        starts = min(self.starts, QUICK_STARTS) if quick else self.starts
        return Options(self.inputs, tuple(self.layers), self.loss, self.scaling, self.spacing, starts, self.seed)


@dataclass(frozen=True)
class Calibrated(Outcome):
    """A calibration with its evidence. folder: with ``model.json`` and ``report.html``."""

    folder: Path
    review: Review

    def lines(self) -> Iterable[str]:
        """The numbers, what they mean, and the files."""
        yield from summary_lines(self.review)
        yield f"model: {self.folder / 'model.json'}"
        yield f"report: {self.folder / 'report.html'}"


@dataclass(frozen=True)
class CalibratedCurves(Outcome):
    """A calibration on curves of homogeneous tests. folder: with ``model.json`` and ``report.html``."""

    folder: Path
    found: CurveCalibration

    def lines(self) -> Iterable[str]:
        """The numbers, what they mean, and the files."""
        yield from self.found.lines()
        yield f"model: {self.folder / 'model.json'}"
        yield f"report: {self.folder / 'report.html'}"


def calibrate(
    experiment: Path,
    /,
    *,
    fit: Fit = Fit(),
    pictures: Pictures = None,
    quick: bool = False,
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> Calibrated | CalibratedCurves | Complete:
    """Identify a neural-network hyperelastic model from an Experiment (.npz of `equigap import` or `simulate`), or from curves.

    Curves of homogeneous tests are a table with columns mode, stretch, stress_MPa (docs/supervised.md). Stresses come out in MPa, or in N/mm (stress times thickness) where the thickness is unknown.

    Args:
        experiment: what was measured or simulated; a table of curves (.csv); or a published one (treloar-a, treloar-b, kawabata, meunier)
        quick: 4 starts, at most 6 pictures: shows the path

    Raises:
        EquigapError: an Experiment or options that cannot be.
        OutputFolderError: the folder holds another run.
    """
    started = time.time()
    if str(experiment) in homogeneous_curves.COLLECTIONS or experiment.suffix.lower() in TABLES:
        if pictures is not None:
            raise ConfigError("--pictures: not for curves of homogeneous tests; leave it out")
        return _of_curves(experiment, fit, quick, started, output, overwrite)
    options = fit.options(quick)
    everything = chosen(Experiment.load(experiment), QUICK_PICTURES if quick and pictures is None else pictures)
    fitted = held_in(everything, fit.hold_out, fit.seed)
    settings = {"command": "calibrate", "quick": quick, "pictures": pictures, **asdict(fit)}
    manifest = Manifest(fit.seed, settings, [experiment], started)
    key = {"command": "calibrate", **settings, "experiment": manifest.read_files}
    folder = open_output_folder(output or default_folder("calibrate", quick), overwrite, key)
    if (answer := earlier_answer(folder)) is not None:
        return Complete(folder, answer)
    with released_if_refused(folder):
        everything, noise = with_found_noise(everything)
        part = everything if fitted.all() else everything.select(fitted.nonzero()[0])
        calibration = fit_network(part, options, callback("assembling"))
        laws, record = compare(calibration), None
        if fit.polish:
            held = None if fitted.all() else everything.select((~fitted).nonzero()[0])
            calibration, record = _polished(calibration, held)
    view = review(calibration, everything, fitted, callback("judging residuals"))
    view = replace(view, classical=laws, polish=record, noise=noise)
    write(folder, view, manifest)
    return _completed(Calibrated(folder, view))


def _polished(calibration: Calibration, held: Experiment | None) -> tuple[Calibration, PolishRecord]:
    """Needs the finite-element package, which a calibration does not."""
    from studies.polish.polished_calibration import polished

    return polished(calibration, held)


def _of_curves(
    source: Path, fit: Fit, quick: bool, started: float, output: Path | None, overwrite: bool
) -> CalibratedCurves | Complete:
    """Raises `ConfigError` for options of a full field."""
    wrong = [
        name
        for name in ("loss", "scaling", "spacing", "polish", "hold_out")
        if getattr(fit, name) != getattr(Fit(), name)
    ]
    if wrong:
        raise ConfigError(f"--{wrong[0].replace('_', '-')}: not for curves of homogeneous tests; leave it out")
    options, settings = fit.options(quick), {"command": "calibrate", "quick": quick, **asdict(fit)}
    manifest = Manifest(fit.seed, settings, [source] if source.suffix else [], started)
    named = str(source) in homogeneous_curves.COLLECTIONS
    curves = homogeneous_curves.load(str(source)) if named else read_curves(source)
    key = {**settings, "curves": source.name, "inputs": manifest.read_files}
    folder = open_output_folder(output or default_folder("calibrate", quick), overwrite, key)
    if (answer := earlier_answer(folder)) is not None:
        return Complete(folder, answer)
    with released_if_refused(folder):
        found = curve_calibration.calibrate_curves(
            source.stem, curves, options.inputs, options.layers, options.starts, options.seed
        )
    curve_calibration.write(folder, found, manifest)
    return _completed(CalibratedCurves(folder, found))


def _completed[C: Calibrated | CalibratedCurves](done: C) -> C:
    """The same; its folder says that it came to its end."""
    complete(done.folder, done.lines())
    return done


def held_in(experiment: Experiment, hold_out: str | None, seed: int) -> NDArray[np.bool_]:
    """Which increments (n_increments,) are used for the fit, of 'last', 'random:0.3', 'every:3' ... or None.

    At least one increment is left on either side. Raises `ConfigError`.
    """
    if hold_out is None:
        return np.ones(experiment.n_increments, bool)
    rule = HoldOut.parse(hold_out, seed)
    if rule.kind == Kind.HALF:
        raise ConfigError(
            f"--hold-out {hold_out}: a calibration holds out increments; give last, random:0.3, every:3 or after:SECONDS"
        )
    return rule.increments(experiment)
