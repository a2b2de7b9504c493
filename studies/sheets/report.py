"""The report on measured data: `MeasuredResults` in; findings, HTML with pictures, JSON and CSV out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from calibrate.diagnosis.selection import DEFAULT
from studies.output import Manifest, write_csv, write_figure, write_json
from studies.output.findings import Finding, Macro
from studies.output.report import Report
from studies.output.words import Words
from studies.sheets import tables
from studies.sheets.figures import FIGURES
from studies.sheets.sheet_results import MeasuredResults, SheetResult, TransferResult
from studies.transfer.transferred import NEO_HOOKE

WORDS = Words("measured")


class SheetCode(Macro):
    """Macros of ``templates/measured.txt``."""

    SHEET = "sheet"
    TRANSFERRED = "transferred"
    CONTROL = "control"


def findings(results: MeasuredResults) -> list[Finding]:
    """The answer of the study."""
    significant = [c.name for c in results.controls.values() if c.smallest_adjusted_p < DEFAULT.significance]
    return [
        *map(_sheet, results.sheets.values()),
        *map(_transfer, results.transfers.values()),
        Finding("measured", SheetCode.CONTROL, {"found": significant}),
    ]


def _sheet(one: SheetResult) -> Finding:
    """The verdict on a sheet, with the errors of the first and the last of its models on increments that were held out."""
    before, after = one.models[0], one.models[-1]
    data: dict[str, Any] = {
        "name": one.name, "verdict": one.verdict, "closest": one.named or one.closest, "before": before.held_out.to_dict(),
        "after": after.held_out.to_dict(), "models": [before.name, after.name],
    }  # fmt: skip
    return Finding("measured", SheetCode.SHEET, data)


def _transfer(one: TransferResult) -> Finding:
    """The last variant beside neo-Hooke."""
    before, after = one.row(NEO_HOOKE), one.rows[-1] if one.varies else one.rows[-2]
    data = {
        "name": one.name, "before": before.held_out.to_dict(), "after": after.held_out.to_dict(), "variant": after.name,
    }  # fmt: skip
    return Finding("measured", SheetCode.TRANSFERRED, data)


def write(folder: Path, results: MeasuredResults, manifest: Manifest) -> tuple[Path, str]:
    """Write everything into `folder`; returns the report's path and the answer in words."""
    found = findings(results)
    files, pictures = [folder / "report.html", *_data(folder, results)], _pictures(folder, results)
    report = Report("Measured data: what a hyperelastic model leaves", "printed sheets under 2D DIC; homogeneous tests")
    report.heading("Findings").paragraph(".\n".join(finding.text for finding in found) + ".")
    report.heading("Sheets").table(*tables.verdict_table(results.sheets), WORDS.verdicts())
    report.table(*tables.error_table(results.sheets), WORDS.errors())
    report.table(*tables.replay_table(results.sheets), WORDS.replays())
    _figure(report, pictures, "errors")
    for one in results.sheets.values():
        report.paragraph(WORDS.answer(name=one.name, answer=one.answer))
    if results.transfers:
        report.heading("Transfer").table(*tables.transfer_table(results.transfers), WORDS.transfers())
        for other in results.transfers.values():
            report.paragraph(".\n".join(other.answer) + ".")
    report.heading("Negative control").table(*tables.control_table(results.controls))
    if results.loops:
        report.heading("Homogeneous tests").table(*tables.loop_table(results.loops))
        for r in results.loops:
            report.paragraph(WORDS.homogeneous_test(name=r.name, question=r.question, verdict=r.verdict))
        _figure(report, pictures, "homogeneous")
    record = manifest.to_dict()
    report.heading("How it was made").details("Settings", record["settings"]).details("Versions", record["versions"])
    report.save(files[0])
    manifest.beside(*files, *pictures.values(), alerts=[finding.to_dict() for finding in found])
    return files[0], "\n".join(finding.text for finding in found)


def _figure(report: Report, pictures: dict[str, Path], name: str) -> None:
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
    """measured.json, verdicts.csv, errors.csv, replays.csv, transfers.csv, homogeneous.csv and control.csv."""
    paths = [folder / "measured.json"]
    write_json(paths[0], results.to_dict())
    found = {
        "verdicts": tables.verdict_table(results.sheets),
        "errors": tables.error_table(results.sheets),
        "replays": tables.replay_table(results.sheets),
        "transfers": tables.transfer_table(results.transfers),
        "homogeneous": tables.loop_table(results.loops),
        "control": tables.control_table(results.controls),
    }
    for name, (columns, lines) in found.items():
        paths.append(folder / f"{name}.csv")
        write_csv(paths[-1], columns, lines)
    return paths
