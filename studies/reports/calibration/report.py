"""Files and report of a calibration; add a table, a figure or a paragraph to the report here."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from studies.output import Manifest, write_csv, write_figure
from studies.output.report import Report
from studies.output.words import Words
from studies.reports import force_record
from studies.reports.alert_table import add_alerts, alert_lines, alert_records, merged
from studies.reports.calibration.calibration_quality import calibration_quality
from studies.reports.calibration.classical_table import classical_record, classical_table, terminal_lines
from studies.reports.calibration.figures import FIGURES
from studies.reports.calibration.fit_findings import findings
from studies.reports.calibration.fit_review import Review
from studies.reports.calibration.polish_record import COLUMNS
from studies.reports.calibration.tables import curve_table, force_table, summary_table
from studies.reports.headline import headline

WORDS = Words("calibration")


def write(folder: Path, view: Review, manifest: Manifest) -> None:
    """Write model, figures, table of forces, report and manifest into `folder`."""
    model, experiment = folder / "model.json", view.experiment
    first = headline(calibration_quality(view))
    replace(view.model, fitness=first.fitness).save(model)
    report = Report(f"Calibration on {experiment.name}", model_name(view))
    report.heading("Result").paragraph(first.text).table(*summary_table(view))
    found = merged(first.reasons, findings(view))
    add_alerts(report, found).heading("Forces and curves")
    if not view.model.level_is_nominal:
        report.table(*force_table(view), WORDS.force_table())
    report.table(*curve_table(view), WORDS.curve_table())
    if view.polish is not None:
        report.table(COLUMNS, view.polish.rows(), WORDS.polish_table())
    if view.classical is not None:
        report.table(*classical_table(view, view.classical), WORDS.classical_table(scale=view.classical.scale))
    report.heading("Evidence")
    for name, draw in FIGURES.items():
        path = folder / f"{name}.png"
        write_figure(path, draw(view), dpi=160)
        report.figure(path, getattr(WORDS, f"figure_{name}")())
    columns, rows = force_record.rows(view.measured, view.forces, experiment.time, view.fitted)
    write_csv(folder / "forces.csv", columns, rows, [WORDS.forces_csv()])
    record = manifest.to_dict()
    report.heading("How it was made")
    report.details("Experiment", {"name": experiment.name, **experiment.provenance})
    report.details("Settings", record["settings"]).details("Versions", record["versions"])
    report.save(folder / "report.html")
    # the manifest is written last: where it is, everything is
    outputs = folder / "report.html", model, folder / "forces.csv"
    manifest.beside(
        *outputs, *report.pictures, headline=first.to_dict(), **view.summary(), classical_laws=classical_record(view),
        polish=None if view.polish is None else view.polish.to_dict(),
        alerts=alert_records(found),
    )  # fmt: skip


def model_name(view: Review) -> str:
    """'physics-augmented neural network of I1, layers (4, 4), 37 parameters; 2484 points, 10 increments'."""
    architecture, experiment = view.model.architecture, view.experiment
    layers = ", ".join(map(str, architecture.layers))
    return (
        f"physics-augmented neural network of {architecture.inputs}, layers ({layers}), {architecture.n_parameters} parameters; "
        f"{len(experiment.points)} points, {len(experiment.triangles)} triangles, "
        f"{experiment.n_increments} increments"
    )


def summary_lines(view: Review) -> Iterator[str]:
    """The numbers and what they mean, for a terminal."""
    first = headline(calibration_quality(view))
    yield first.text
    yield f"{view.experiment.name}: {model_name(view)}"
    _, rows = summary_table(view)
    width = max(len(str(row[0])) for row in rows)
    for name, value, unit in rows:
        text = f"{value:.4g}" if isinstance(value, float) else str(value)
        yield f"  {name:{width}}  {text} {unit}".rstrip()
    yield from terminal_lines(view.classical, view.model.unit)
    yield from alert_lines(merged(first.reasons, findings(view)))
