"""Files and report of a prediction: curves of homogeneous tests, or forces of another test."""

from __future__ import annotations

from pathlib import Path

from calibrate.models.diagnosed_law import DiagnosedLaw
from calibrate.models.network_model import Model
from studies.output import Manifest, write_csv, write_figure
from studies.output.report import Report
from studies.output.words import Words
from studies.reports import force_record
from studies.reports.alert_table import add_alerts, alert_records
from studies.reports.prediction.figures import draw_curves, draw_forces
from studies.reports.prediction.predicted_curves import Curve, band_finding, findings
from studies.reports.prediction.predicted_forces import Forecast
from studies.reports.prediction.tables import curve_ends, curve_rows

WORDS = Words("prediction")


def write_curves(
    folder: Path, law: Model | DiagnosedLaw, curves: list[Curve], manifest: Manifest, against: str | None
) -> Path:
    """``curves.csv``, ``curves.png``, a manifest and ``report.html``, whose path is returned. against: known material."""
    table, picture = folder / "curves.csv", folder / "curves.png"
    model = law.model if isinstance(law, DiagnosedLaw) else law
    columns, rows = curve_rows(curves, model.unit)
    write_csv(table, columns, rows, [WORDS.curves_csv(unit=model.unit, bands=band_finding(law).text)])
    write_figure(picture, draw_curves(curves, model.unit, against))
    found = findings(law, curves)
    manifest.beside(
        picture, table, unit=model.unit, calibrated_stretch={c.name: c.limit for c in curves},
        alerts=alert_records(found),
    )  # fmt: skip
    report = Report("Predicted homogeneous tests", _what(law))
    if model.unit == "N/mm":
        report.paragraph(WORDS.thickness_unknown())
    report.figure(picture, WORDS.curves_caption(bands=any(c.band is not None for c in curves)))
    report.table(*curve_ends(curves, model.unit), WORDS.curves_table())
    add_alerts(report, found)
    ranges = {name: f"{low:.4g} to {high:.4g}" for name, (low, high) in model.calibrated_range.items()}
    report.details("Calibrated range", ranges).details("Versions", manifest.to_dict()["versions"])
    return report.save(folder / "report.html")


def _what(law: Model | DiagnosedLaw) -> str:
    """Subtitle."""
    if isinstance(law, DiagnosedLaw):
        return f"Found by a diagnosis: {' and '.join(['energy of I1', *(a.effect.name for a in law.of_material)])}"
    layers = ", ".join(map(str, law.architecture.layers))
    return f"Physics-augmented neural network (PANN) of {law.architecture.inputs}, layers ({layers})"


def write_forces(folder: Path, forecast: Forecast, manifest: Manifest) -> Path:
    """``forces.csv``, ``forces.png``, a manifest and ``report.html``, whose path is returned."""
    table, picture = folder / "forces.csv", folder / "forces.png"
    columns, rows = force_record.rows(forecast.measured, forecast.forces, forecast.experiment.time)
    write_csv(table, columns, rows, [WORDS.forces_csv()])
    write_figure(picture, draw_forces(forecast))
    manifest.beside(
        picture, table, relative_force_error=forecast.error, factor=forecast.factor, outside=forecast.outside,
        alerts=alert_records(forecast.findings),
    )  # fmt: skip
    report = Report(f"Prediction of {forecast.experiment.name}", forecast.model)
    report.figure(picture, WORDS.forces_caption())
    add_alerts(report, forecast.findings)
    report.heading("Forces").table(columns, rows, WORDS.forces_table()).details(
        "Versions", manifest.to_dict()["versions"]
    )
    return report.save(folder / "report.html")
