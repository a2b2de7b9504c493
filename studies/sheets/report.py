"""The report on measured data: `MeasuredResults` in; HTML with pictures, JSON and CSV out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from studies.output import Manifest, write_csv, write_figure, write_json
from studies.output.report import Report
from studies.output.words import Words
from studies.sheets import tables
from studies.sheets.figures import FIGURES
from studies.sheets.measured_results import MeasuredResults
from studies.sheets.sheet_findings import findings, sheet
from studies.sheets.sheet_results import ModelName, SheetResult

WORDS = Words("measured")
ERROR_COLUMNS = ["sheet", "step", "model", "increments", "force", "field", "mean_force", "section_scatter", "lower_over_upper"]  # fmt: skip


def write(folder: Path, results: MeasuredResults, manifest: Manifest) -> tuple[Path, str]:
    """Write everything into `folder`; returns the report's path and the answer in words."""
    found = findings(results)
    files, pictures = [folder / "report.html", *_data(folder, results)], _pictures(folder, results)
    report = Report("Measured data: what a hyperelastic model leaves", "printed sheets under 2D DIC; homogeneous tests")
    report.heading("Findings").paragraph(".\n".join(finding.text for finding in found) + ".")
    report.heading("The records").table(*tables.record_table(results.records)).paragraph(WORDS.initial_warp())
    _figures(report, pictures, "records")
    report.heading(f"Learnt on {results.first.name}")
    _learnt(report, results.first)
    report.heading("Strain or time").paragraph(WORDS.strain_or_time()).table(*tables.rival_table(results))
    report.heading("Contraction").paragraph(WORDS.contraction())
    report.heading(f"Transferred to {results.second.name}, one factor refitted")
    report.table(*tables.error_table(results.second.models))
    report.heading(f"The same procedure on {results.own.name} alone")
    _learnt(report, results.own)
    _figures(report, pictures, "sections", "grips")
    report.heading(f"What differs in {results.hetero.name}")
    report.table(*tables.error_table(results.hetero.models)).table(*tables.map_table(results.map))
    _figures(report, pictures, "stiffness")
    report.heading("Negative control").table(*tables.control_table(results.controls))
    _homogeneous(report, results, pictures)
    record = manifest.to_dict()
    report.heading("How it was made").details("Settings", record["settings"]).details("Versions", record["versions"])
    report.save(files[0])
    manifest.beside(*files, *pictures.values(), alerts=[finding.to_dict() for finding in found])
    return files[0], "\n".join(finding.text for finding in found)


def _learnt(report: Report, learnt: SheetResult) -> None:
    """What was learnt on one sheet."""
    report.paragraph(sheet(learnt).text + ".")
    report.table(*tables.error_table(learnt.models)).table(*tables.amplitude_table(learnt))
    report.table(*tables.effect_table(learnt), WORDS.effect_table())
    report.table(*tables.leave_one_out_table(learnt), WORDS.leave_one_out_table())
    report.table(*tables.variant_table(learnt), WORDS.variant_table())


def _homogeneous(report: Report, results: MeasuredResults, pictures: dict[str, Path]) -> None:
    columns, rows = tables.loop_table(results.loops)
    if not rows:
        return
    report.heading("Homogeneous tests").table(columns, rows)
    for r in results.loops:
        report.paragraph(WORDS.homogeneous_test(name=r.name, question=r.question, verdict=r.verdict))
    _figures(report, pictures, "homogeneous")


def _figures(report: Report, pictures: dict[str, Path], *names: str) -> None:
    for name in names:
        if name in pictures:
            report.figure(pictures[name], getattr(WORDS, f"figure_{name}")())


def _pictures(folder: Path, results: MeasuredResults) -> dict[str, Path]:
    drawn = {}
    for name, draw in FIGURES.items():
        figure = draw(results)
        if figure is not None:
            drawn[name] = folder / f"{name}.png"
            write_figure(drawn[name], figure, dpi=130)
    return drawn


def _data(folder: Path, results: MeasuredResults) -> list[Path]:
    """measured.json, errors.csv, effects.csv, sections.csv, homogeneous.csv, control.csv, and model files."""
    paths = [folder / "measured.json"]
    write_json(paths[0], results.to_dict())
    for learnt in results.learnt.values():
        paths.append(folder / f"model_{learnt.name}.json")
        (model,) = learnt.model(ModelName.RETAINED).members
        write_json(paths[-1], model)
    found = {
        "errors": (ERROR_COLUMNS, _errors(results)),
        "sections": _sections(results),
        "homogeneous": tables.loop_table(results.loops),
        "control": tables.control_table(results.controls),
        "effects": _effects(results),
    }
    for name, (columns, lines) in found.items():
        paths.append(folder / f"{name}.csv")
        write_csv(paths[-1], columns, lines)
    return paths


def _errors(results: MeasuredResults) -> list[list[Any]]:
    """Errors of every model on every sheet, and of the stiffness map."""
    rows: list[list[Any]] = []
    for key, one in results.sheets.items():
        for model in one.models:
            for part, found in model.errors.to_dict().items():
                rows.append([one.name, key, model.name, part, *(found[name] for name in ERROR_COLUMNS[4:])])
    for part, changes in results.map.errors.to_dict().items():
        for when, found in changes.items():
            rows.append([results.map.name, "map", WORDS.varying(when=when), part, found["force"], found["field"], None, None, None])  # fmt: skip
    return rows


def _sections(results: MeasuredResults) -> tables.Table:
    """Section force over measured force of every model, in every band and increment."""
    rows: list[list[Any]] = []
    for key, one in results.sheets.items():
        for model in one.models:
            for time, values in zip(one.time, model.sections, strict=True):
                rows.append([one.name, key, model.name, time, *values])
    return ["sheet", "step", "model", "time_s", *(f"band_{i}" for i in range(1, len(rows[0]) - 3))], rows


def _effects(results: MeasuredResults) -> tables.Table:
    """The effect tables of both sheets."""
    found = [(learnt.name, tables.effect_table(learnt)) for learnt in results.learnt.values()]
    columns = ["sheet", *found[0][1][0]]
    return columns, [[name, *line] for name, (_, rows) in found for line in rows]
