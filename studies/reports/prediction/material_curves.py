"""Stress over stretch of the material that a diagnosis found: the picture that a reader of rubber looks for first.

In: the models that a diagnosis leaves as files, the one to use among them. Out: a section of its report, and ``curves.png``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from calibrate.models.extended_model import ExtendedModel
from studies.errors import OptionError
from studies.output import write_figure
from studies.output.report import Report
from studies.output.words import Words
from studies.reports.prediction.diagnosed_curves import DiagnosedLaw
from studies.reports.prediction.figures import draw_curves
from studies.reports.prediction.predicted_curves import predict

WORDS = Words("discovery")


def add_curves(report: Report, folder: Path, models: Mapping[str, ExtendedModel], used: str) -> None:
    """Three homogeneous tests of the material of a file among `models`, infinitely slow."""
    law = DiagnosedLaw(models[used])
    report.heading("Stress over stretch")
    try:
        curves = predict(law)
    except OptionError as error:
        report.paragraph(WORDS.no_curves(file=used, reason=str(error)))
        return
    path = folder / "curves.png"
    write_figure(path, draw_curves(curves, law.model.unit), dpi=140)
    of_material, model = [a.effect.name for a in law.of_material], law.model
    report.figure(
        path,
        WORDS.material_curves(file=used, effects=of_material, relaxes=model.relaxes, nominal=model.level_is_nominal),
    )
