"""The thickness study: how thick may a specimen be? One cross in 2D and 3D, calibrated as if in plane stress.

In: `Results`. Out: the page of its report: fields of epsilon, ``fits.csv``, ``fields.csv``, ``forces.csv``, ``verdicts.csv``,
figures of deformation and of the calibrated models, claims.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from studies.grid.axes import PLANE, Loss, Settings
from studies.grid.case import EXTRAPOLATION
from studies.grid.presets import thickness_figures, thickness_models, thickness_tables
from studies.grid.presets.thickness_claims import CHANGE_COLUMNS, change_rows, claims
from studies.grid.presets.thickness_results import ThicknessResults, hole_edge
from studies.grid.presets.thickness_tables import LIMITS
from studies.grid.report import COMMON, Page, Picture, Section, Table, Text, View, claims_section
from studies.grid.results import Results
from studies.grid.study import Preset
from studies.output.words import Words
from studies.reports import solid_pictures, solid_view

WORDS = Words("thickness")
OF_THE_PAPER = ("10", "15", "20", "40")  # mm
FINE = 0.5  # forward_size of --fine: 0.6 mm elements at the holes instead of 1.2 mm


def page(results: Results) -> Page:
    """The report."""
    study = ThicknessResults(results.folder, results.settings)
    sections = [method(study), answer(study), beside_the_paper(study), deformation(study), forces(study), solid(study)]
    return Page("Thickness study", WORDS.question(), [*sections, *(models(study, loss) for loss in study.losses)])


def method(results: ThicknessResults) -> Section:
    """What was done."""
    edge = hole_edge(results.plane.mesh)
    told = WORDS.method(settings=results.settings, thicknesses=results.thicknesses, edge=edge, limit=results.limit)
    missing = [h for h in OF_THE_PAPER if h not in results.thicknesses]
    return Section("", [Text(told), *([Text(WORDS.missing(thicknesses=missing))] if missing else [])])


def answer(results: ThicknessResults) -> Section:
    """Up to which thickness a calibration can be trusted."""
    tables = thickness_tables
    judged = [
        one.row() for loss in results.losses for noisy in (False, True) for one in tables.trusts(results, loss, noisy)
    ]
    corrected = tables.correction_rows(results)
    return Section("Answer", [
        Text(WORDS.definition(limits=LIMITS)),
        Table(tables.REACH_COLUMNS, tables.reach_rows(results), WORDS.reach()),
        Table(tables.VERDICT_COLUMNS, judged, f"{WORDS.verdicts()}. {COMMON.settings_caption(losses=results.losses)}", "verdicts.csv"),
        *([Table(tables.CORRECTION_COLUMNS, corrected, WORDS.correction())] if corrected else []),
        Table(tables.OUTSIDE_COLUMNS, tables.outside_rows(results), WORDS.outside(extrapolation=EXTRAPOLATION)),
        Text(WORDS.condition()),
    ])  # fmt: skip


def beside_the_paper(results: ThicknessResults) -> Section:
    """Claims, what the losses make of the same data, what was not tested."""
    section = claims_section(claims(results))
    return Section(
        section.heading, [*section.parts, Table(CHANGE_COLUMNS, change_rows(results)), Text(WORDS.untested())]
    )


def deformation(results: ThicknessResults) -> Section:
    """Where 2D and 3D differ."""
    tables = thickness_tables
    rows = [tables.field_row(name, field) for name, field in results.fields.items()]
    name, (_, _, _, p95, _, top, at, rim, *_) = results.thicknesses[0], rows[0]
    return Section("Where 2D and 3D differ", [
        Text(WORDS.worst_place(name=name, at=at, rim=rim, top=top, p95=p95)),
        *(Picture(kind, partial(getattr(thickness_figures, kind), results), getattr(WORDS, kind)())
          for kind in ("maps", "lines", "growth")),
        Table(tables.FIELD_COLUMNS, rows, "ε at the last increment, by area", "fields.csv"),
        Table(tables.LINE_COLUMNS, tables.line_rows(results), "Decay of ε from the rims"),
    ])  # fmt: skip


def forces(results: ThicknessResults) -> Section:
    """Forces of whole arms."""
    return Section("Forces", [
        Picture("forces", lambda: thickness_figures.forces(results), WORDS.forces()),
        Table(thickness_tables.FORCE_COLUMNS, thickness_tables.force_rows(results), "Forces of whole arms", "forces.csv"),
    ])  # fmt: skip


def solid(results: ThicknessResults) -> Section:
    """Pictures of the thinnest and the thickest solid, and how smooth their pressure is."""
    solids = {h: results.solid(h) for h in dict.fromkeys((results.thicknesses[0], results.thicknesses[-1]))}
    jumps = [[h, *(100 * np.quantile(solid_pictures.pressure_jumps(results.solid(h)), (0.5, 0.95))).tolist()]
             for h in results.thicknesses]  # fmt: skip
    return Section("The solid", [
        Picture("contraction", lambda: solid_pictures.contraction(solids), WORDS.contraction()),
        View(solid_view.contraction_scenes(solids), solid_view.LABEL, WORDS.view()),
        Table(("thickness (mm)", "median (%)", "P95 (%)"), jumps, WORDS.jumps()),
        Picture("pressure", lambda: solid_pictures.pressure(solids), WORDS.pressure()),
    ])  # fmt: skip


def models(results: ThicknessResults, loss: Loss) -> Section:
    """Figures and tables of the models that a loss has calibrated."""
    kinds: dict[str, dict[str, Any]] = {"densities": {"limit": LIMITS.stress}, "energies": {}, "predictions": {}}
    pictures = [Picture(f"{kind}_{loss}", partial(getattr(thickness_models, kind), results, loss), getattr(WORDS, kind)(**values))
                for kind, values in kinds.items()]  # fmt: skip
    titles = {
        "Predictions inside the calibrated range": thickness_tables.AGREEMENT,
        "Stress errors": thickness_tables.STRESSES,
    }
    tables = [Table(("condition", "noise", "fits", *quantities), thickness_tables.wide_rows(results, quantities, loss), WORDS.wide(title=title))
              for title, quantities in titles.items()]  # fmt: skip
    every = [] if loss is not results.losses[0] else [
        Table(thickness_tables.FIT_COLUMNS, thickness_tables.fit_rows(results), file="fits.csv", shown=False)
    ]  # fmt: skip
    name = COMMON.loss(name=loss)
    return Section(name[0].upper() + name[1:], [*pictures, *tables, *every])


LOSSES = tuple(loss for loss in Loss if loss is not Loss.POLISHED)  # a polish solves sheets in plane stress
DEFAULT = Settings("thickness", thicknesses=(PLANE, *OF_THE_PAPER), losses=LOSSES, batch=6, plane_reference=True)
QUICK = replace(DEFAULT, nodes=2500, seeds=(0, 1), starts=8, thicknesses=(PLANE, "10", "40"))
THICKNESS = Preset(DEFAULT, QUICK, page)
