"""Table, judgement and report of the convergence of the 3D model.

In: the JSONs of the runs. Out: ``convergence.csv``, ``convergence.md`` (the same table for the documentation) and
``report.html``. Changes are against the next finer setting of the same series.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

from studies.grid.convergence_runs import (
    DISPLACEMENT,
    FINE,
    GRIP_ZONE,
    INCREMENTS,
    NEAR,
    Run,
    RunResult,
    Series,
    result_path,
)  # fmt: skip
from studies.output import Manifest, write_csv, write_text
from studies.output.report import Report
from studies.output.words import Words

COLUMNS = ("series", "setting", "unknowns", "force x (N)", "force y (N)", "change of force (%)", "ε P95", "change of P95 (%)",
           "ε max", f"ε P95 beyond {GRIP_ZONE:g} mm from grips", f"ε mean within {NEAR:g} mm of a rim", f"ε P95 within {NEAR:g} mm of a rim",
           f"ε max within {NEAR:g} mm of a rim", "median jump of pressure (% of range)", "linear solves", "CPU seconds",
           "peak memory (MB)")  # fmt: skip
TARGETS = {"force": 0.1, "p95": 5.0, "floor": 0.002}
TARGET_COLUMNS = ("target", "limit", "found", "met")


def write(folder: Path, study: Sequence[Series]) -> Path:
    """Write everything; returns the path of the report."""
    results = {run: RunResult.load(result_path(folder, run)) for part in study for run in part.runs}
    rows = table(study, results)
    manifest = Manifest(settings={"displacement": DISPLACEMENT, "increments": INCREMENTS},
                        inputs=sorted((folder / "runs").glob("*.json")))  # fmt: skip
    write_csv(folder / "convergence.csv", COLUMNS, rows)
    manifest.beside(folder / "convergence.csv")
    write_text(folder / "convergence.md", markdown(rows, targets(study, results)))
    manifest.beside(folder / "convergence.md")
    return compose(folder, study, results, rows)


def change(row: RunResult, finer: RunResult | None, key: str) -> float | None:
    """(row - finer) / finer, %; None for the finest."""
    return None if finer is None else 100 * (getattr(row, key) / getattr(finer, key) - 1)


def force_change(row: RunResult, finer: RunResult | None) -> float | None:
    """The larger change of the two forces, %."""
    changes = [found for key in ("force_x", "force_y") if (found := change(row, finer, key)) is not None]
    return max(changes, key=abs, default=None)


def table(study: Sequence[Series], results: dict[Run, RunResult]) -> list[list[Any]]:
    """One row a run of a series; see `COLUMNS`."""
    rows = []
    for part in study:
        found = [results[run] for run in part.runs]
        for row, finer in zip_longest(found, found[1:]):
            same = finer if finer is not None and finer.run.grips == row.run.grips else None
            rows.append([
                part.name, part.varied(row), row.unknowns, row.force_x, row.force_y, force_change(row, same), row.p95,
                change(row, same, "p95"), row.max, row.p95_inner, row.mean_near, row.p95_near, row.max_near,
                100 * row.pressure_jump, row.solves, row.seconds, row.memory,
            ])  # fmt: skip
    return rows


def targets(study: Sequence[Series], results: dict[Run, RunResult]) -> list[list[Any]]:
    """Rows of `TARGET_COLUMNS`: the last refinement that leads to --fine, and the floor there; empty without --fine."""
    rows: list[list[Any]] = []
    for part in study:
        factors = [run.size_factor for run in part.runs]
        if FINE not in factors[1:] or len(set(factors)) < len(factors):
            continue
        place = factors.index(FINE)
        before, fine = results[part.runs[place - 1]], results[part.runs[place]]
        if fine.run.thickness == 1.0:
            rows += floor_targets(part.name, fine)
        else:
            rows += change_targets(part.name, before, fine)
    return rows


def floor_targets(name: str, fine: RunResult) -> list[list[Any]]:
    """Whether epsilon of a sheet is as small as it should be."""
    limit = TARGETS["floor"]
    kinds = {"mean": fine.mean_near, "95th percentile": fine.p95_near, "maximum": fine.max_near}
    return [[f"{name}: within {NEAR:g} mm of a rim, {kind}", f"{limit:g}", found, found <= limit]
            for kind, found in kinds.items()]  # fmt: skip


def change_targets(name: str, before: RunResult, fine: RunResult) -> list[list[Any]]:
    """Whether a refinement changes force and epsilon little enough."""
    rows: list[list[Any]] = []
    kinds = {"force": ("force", force_change(before, fine)), "p95": ("ε P95", change(before, fine, "p95"))}
    for key, (kind, found) in kinds.items():
        assert found is not None
        words = f"{name}: change of {kind}, {before.edge:.2f} to {fine.edge:.2f} mm (%)"
        rows.append([words, f"{TARGETS[key]:g} %", found, abs(found) <= TARGETS[key]])
    return rows


def markdown(rows: list[list[Any]], judged: list[list[Any]]) -> str:
    """Every table for the documentation."""
    text = []
    for name in dict.fromkeys(row[0] for row in rows):
        text += [
            f"**{name[0].upper() + name[1:]}**",
            "",
            *_lines(COLUMNS[1:], [r[1:] for r in rows if r[0] == name]),
            "",
        ]
    return "\n".join([*text, *(["**Targets**", "", *_lines(TARGET_COLUMNS, judged)] if judged else [])]) + "\n"


def _lines(columns: Sequence[str], rows: list[list[Any]]) -> list[str]:
    head = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return [*head, *("| " + " | ".join(map(_cell, row)) + " |" for row in rows)]


def _cell(value: Any) -> str:
    """Numbers with four digits, as in the report."""
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"
    return {None: "", True: "yes", False: "no"}[value] if value is None or isinstance(value, bool) else str(value)


def compose(folder: Path, study: Sequence[Series], results: dict[Run, RunResult], rows: list[list[Any]]) -> Path:
    """The HTML report."""
    words = Words("thickness")
    report = Report(
        "Convergence of the 3D model", "What the size of hexes, their layers and the bulk modulus are worth"
    )
    report.paragraph(words.convergence_method(displacement=DISPLACEMENT, increments=INCREMENTS))
    judged = targets(study, results)
    if judged:
        report.heading("Targets").table(TARGET_COLUMNS, judged)
    else:
        report.paragraph(words.convergence_quick())
    for part in study:
        report.heading(part.name[0].upper() + part.name[1:])
        report.table(COLUMNS[1:], [row[1:] for row in rows if row[0] == part.name])
    report.paragraph(words.floor())
    solvers = sorted({row.solver for row in results.values()})
    report.details("Settings", {"runs": len(results), "linear solver": ", ".join(solvers)})
    return report.save(folder / "report.html")
