"""Stress over stretch of the material that a diagnosis found: the picture that a reader of rubber looks for first.

In: the models that a diagnosis leaves as files, the one to use among them. Out: a section of its report, ``curves.png``, and ``curves.csv`` with its numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from calibrate.errors import FitError
from calibrate.models.diagnosed_law import DiagnosedLaw
from calibrate.models.extended_model import ExtendedModel
from studies.output import write_csv, write_figure
from studies.output.report import Report
from studies.output.words import Words
from studies.reports.prediction.figures import draw_curves
from studies.reports.prediction.predicted_curves import predict
from studies.reports.prediction.tables import curve_rows

WORDS = Words("prediction")
PICTURE, TABLE = "curves.png", "curves.csv"


def add_curves(report: Report, folder: Path, models: Mapping[str, ExtendedModel], used: str) -> list[Path]:
    """Three homogeneous tests of the material of a file among `models`, infinitely slow; the tables that were written."""
    law = DiagnosedLaw(models[used])
    report.heading("Stress over stretch")
    try:
        curves = predict(law)
    except FitError as error:
        report.paragraph(WORDS.no_curves(file=used, reason=str(error)))
        return []
    path, table, unit = folder / PICTURE, folder / TABLE, law.model.unit
    write_figure(path, draw_curves(curves, unit), dpi=140)
    write_csv(table, *curve_rows(curves, unit), [WORDS.curves_csv(unit=unit, bands=f"Of {used}.")])
    of_material, model = [a.effect.name for a in law.of_material], law.model
    caption = WORDS.material_curves(
        file=used, effects=of_material, relaxes=model.relaxes, nominal=model.level_is_nominal,
        bands=model.uncertainty is not None,
    )  # fmt: skip
    report.figure(path, caption)
    return [table]
