"""Files and report of supervised fits: table, models, a figure of every data set, manifests, ``report.html``."""

from __future__ import annotations

from pathlib import Path

from studies.output import Manifest, write_csv, write_figure
from studies.output.report import Report
from studies.output.words import Words
from studies.reports.supervised.figures import draw
from studies.reports.supervised.supervised_fits import COLUMNS, Result, table_rows

WORDS = Words("supervised")


def write(folder: Path, results: list[Result], manifest: Manifest) -> Path:
    """Write everything into `folder`; returns the path of the report."""
    table, record = folder / "supervised.csv", manifest.to_dict()
    rows = table_rows(results)
    write_csv(table, COLUMNS, rows, [f"starts {record['settings']['starts']}, seed {record['seed']}"])
    for r in results:
        r.model.save(folder / "models" / f"{r.case.name}.json")
    report = Report("Supervised fits", "Networks fitted directly to stress-stretch curves of homogeneous tests")
    report.paragraph(WORDS.r2())
    pictures = []
    for name in dict.fromkeys(r.case.data for r in results):
        pictures.append(folder / f"{name}.png")
        write_figure(pictures[-1], draw(name, [r for r in results if r.case.data == name]), dpi=150)
        manifest.beside(pictures[-1])
        report.figure(pictures[-1], WORDS.figure(name=name))
    manifest.beside(table, *pictures, r2={r.case.name: r.r2 for r in results})
    report.table(COLUMNS, rows, WORDS.table())
    report.details("Settings", record["settings"]).details("Versions", record["versions"])
    return report.save(folder / "report.html")
