"""A calibration on stress-stretch curves: what it found, its files and report.

In: curves, options of the network. Out: `CurveCalibration`; ``model.json``, ``curves.csv``, ``curves.png``, ``report.html``, a manifest.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from calibrate.equations.deformation_modes import TITLES
from calibrate.fitting.classical_fit import ClassicalFit, Comparison
from calibrate.fitting.homogeneous.curve_laws import compare_curves
from calibrate.fitting.homogeneous.sobolev_fit import Curves, SupervisedFit, fit_supervised, gradients
from calibrate.models.fitness import Fitness, Use
from studies.accuracy.metrics import r2
from studies.output import Manifest, style, write_csv, write_figure
from studies.output.findings import Finding, Macro
from studies.output.report import Report
from studies.output.words import Words
from studies.reports.alert_table import add_alerts, alert_lines, alert_records
from studies.reports.calibration.classical_table import curve_laws, curve_laws_record, terminal_lines
from studies.reports.calibration.fit_findings import classical_finding, stiffness

WORDS, LAWS = Words("curves"), Words("calibration")
GOOD, POOR = 0.05, 0.2  # stress error of the worst mode, up to which a model is usable, and with reservations


class CurveCode(Macro):
    """Macros of ``templates/curves.txt``."""

    NO_FIELD = "no_field"


@dataclass(frozen=True, eq=False)
class CurveCalibration:
    """name: of the data; errors: of every mode, root mean square over its largest stress."""

    name: str
    curves: Curves
    fit: SupervisedFit
    laws: Comparison

    @property
    def errors(self) -> dict[str, float]:
        """Of the network, by mode."""
        return {
            mode: float(np.sqrt(np.mean((self.fit.model.homogeneous(mode, x) - P) ** 2)) / np.abs(P).max())
            for mode, (x, P) in self.curves.items()
        }

    @property
    def fitness(self) -> Fitness:
        """By the worst mode."""
        worst = max(self.errors, key=self.errors.__getitem__)
        error = self.errors[worst]
        verdict = Use.USABLE if error <= GOOD else Use.RESERVATIONS if error <= POOR else Use.NOT
        return Fitness(verdict, (WORDS.worst(mode=TITLES[worst], error=error),))

    @property
    def findings(self) -> list[Finding]:
        """What a reader should know."""
        laws = classical_finding(self.laws, self.fit.model.architecture.inputs)
        return [laws, *stiffness(self.fit.model), Finding("curves", CurveCode.NO_FIELD)]

    def lines(self) -> Iterator[str]:
        """What was found, for a terminal."""
        yield f"{str(self.fitness.verdict).capitalize()}: {' '.join(self.fitness.reasons)}"
        architecture = self.fit.model.architecture
        points = sum(len(x) for x, _ in self.curves.values())
        yield f"{self.name}: physics-augmented neural network of {architecture.inputs}, {architecture.n_parameters} parameters; {points} points"
        for mode, error in self.errors.items():
            yield f"  {TITLES[mode]}: error {100 * error:.2g} % of the largest stress"
        yield from terminal_lines(self.laws, "MPa")
        yield from alert_lines(self.findings)


def calibrate_curves(
    name: str, curves: Curves, inputs: str, layers: tuple[int, ...], starts: int, seed: int
) -> CurveCalibration:
    """Fit network and classical laws. Raises the errors of `fit_supervised`."""
    fit = fit_supervised(curves, inputs, layers, starts, seed)
    return CurveCalibration(name, curves, fit, compare_curves(curves, fit))


def write(folder: Path, found: CurveCalibration, manifest: Manifest) -> None:
    """Write model, table, figure, report and manifest into `folder`."""
    model, table, picture = folder / "model.json", folder / "curves.csv", folder / "curves.png"
    replace(found.fit.model, fitness=found.fitness).save(model)
    write_csv(table, ("mode", "stretch", "stress_MPa", "network_MPa"), _rows(found))
    write_figure(picture, _figure(found), dpi=150)
    first, *rest = found.lines()
    report = Report(f"Calibration on {found.name}", rest[0]).heading("Result").paragraph(first)
    report.table(("mode", "points", "stretch from", "to", "error, %", "r2"), _quality(found), WORDS.errors())
    report.table(*curve_laws(found.laws, "MPa"), LAWS.classical_table(scale=found.laws.scale))
    add_alerts(report, found.findings).heading("Evidence").figure(picture, WORDS.figure())
    record = manifest.to_dict()
    report.heading("How it was made").details("Settings", record["settings"]).details("Versions", record["versions"])
    report.save(folder / "report.html")
    manifest.beside(
        folder / "report.html", model, table, picture,
        headline=found.fitness.to_dict(), stress_errors=found.errors, classical_laws=curve_laws_record(found.laws, "MPa"),
        alerts=alert_records(found.findings),
    )  # fmt: skip


def _rows(found: CurveCalibration) -> list[tuple[Any, ...]]:
    return [
        (mode, float(a), float(b), float(c))
        for mode, (x, P) in found.curves.items()
        for a, b, c in zip(x, P, found.fit.model.homogeneous(mode, x), strict=True)
    ]


def _quality(found: CurveCalibration) -> list[tuple[Any, ...]]:
    return [
        (TITLES[mode], len(x), f"{x.min():.3g}", f"{x.max():.3g}", f"{100 * found.errors[mode]:.2g}",
         f"{r2(P, found.fit.model.homogeneous(mode, x)):.4f}")
        for mode, (x, P) in found.curves.items()
    ]  # fmt: skip


def _figure(found: CurveCalibration) -> Figure:
    best = found.laws.converged[0].fit if found.laws.converged else None
    with style.figure(11, 3.6) as drawn:
        for ax, (mode, (x, P)) in zip(
            drawn.subplots(1, len(found.curves), squeeze=False)[0], found.curves.items(), strict=True
        ):
            fine = np.linspace(min(1.0, float(x.min())), float(x.max()), 200)
            ax.plot(x, P, "o", color="0.3", markersize=3.5, label="measured")
            ax.plot(fine, found.fit.model.homogeneous(mode, fine), label="network")
            if best is not None:
                ax.plot(fine, _law_curve(best, mode, fine), "--", label=best.law.name)
            ax.set(xlabel="stretch", ylabel="nominal stress (MPa)", title=TITLES[mode])
            ax.legend(fontsize=7)
    return drawn


def _law_curve(fit: ClassicalFit, mode: str, stretch: np.ndarray) -> np.ndarray:
    F = gradients({mode: (stretch, np.ones_like(stretch))})[0]
    return np.asarray(fit.law.stress(F, fit.found.parameters)[:, 0, 0])
