"""Table, judgement and report of the convergence of the 3D model.

In: the JSONs of the runs. Out: ``convergence.csv``, ``convergence.md`` (the same table for the documentation) and
``report.html``. Changes are against the next finer setting of the same series.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from studies.grid.thickness_convergence import DISPLACEMENT, FINE, GRIP_ZONE, INCREMENTS, NEAR, Row, Series, result_path
from studies.output import Manifest, write_csv, write_text
from studies.output.report import Report

COLUMNS = ("series", "setting", "unknowns", "force x (N)", "force y (N)", "change of force (%)", "ε P95", "change of P95 (%)",
           "ε max", f"ε P95 beyond {GRIP_ZONE:g} mm from grips", f"ε mean within {NEAR:g} mm of a rim", f"ε P95 within {NEAR:g} mm of a rim",
           f"ε max within {NEAR:g} mm of a rim", "median jump of pressure (% of range)", "linear solves", "CPU seconds",
           "peak memory (MB)")  # fmt: skip
TARGETS = {"force": 0.1, "p95": 5.0, "floor": 0.002}
TARGET_COLUMNS = ("target", "limit", "found", "met")


def write(folder: Path, study: Sequence[Series]) -> Path:
    """Write everything; returns the path of the report."""
    results = {run: json.loads(result_path(folder, run).read_text()) for part in study for run in part.runs}
    rows = table(study, results)
    manifest = Manifest(settings={"displacement": DISPLACEMENT, "increments": INCREMENTS},
                        inputs=sorted((folder / "runs").glob("*.json")))  # fmt: skip
    write_csv(folder / "convergence.csv", COLUMNS, rows)
    manifest.beside(folder / "convergence.csv")
    write_text(folder / "convergence.md", markdown(rows, targets(study, results)))
    manifest.beside(folder / "convergence.md")
    return compose(folder, study, results, rows)


def change(row: Row, finer: Row | None, key: str) -> float | None:
    """(row - finer) / finer, %; None for the finest."""
    return None if finer is None else 100 * (row[key] / finer[key] - 1)


def force_change(row: Row, finer: Row | None) -> float | None:
    """The larger change of the two forces, %."""
    if finer is None:
        return None
    return max((100 * (row[key] / finer[key] - 1) for key in ("force_x", "force_y")), key=abs)


def table(study: Sequence[Series], results: dict[Any, Row]) -> list[list[Any]]:
    """One row a run of a series; see `COLUMNS`."""
    rows = []
    for part in study:
        found: list[Row | None] = [*(results[run] for run in part.runs), None]
        for row, finer in pairwise(found):
            assert row is not None
            if finer is not None and finer["grips"] != row["grips"]:
                finer = None
            rows.append([
                part.name, part.varied(row), row["unknowns"], row["force_x"], row["force_y"], force_change(row, finer),
                row["p95"], change(row, finer, "p95"), row["max"], row["p95_inner"], row["mean_near"], row["p95_near"], row["max_near"],
                100 * row["pressure_jump"], row["solves"], row["seconds"], row["memory"],
            ])  # fmt: skip
    return rows


def targets(study: Sequence[Series], results: dict[Any, Row]) -> list[list[Any]]:
    """Rows of `TARGET_COLUMNS`: the last refinement that leads to --fine, and the floor there; empty without --fine."""
    rows: list[list[Any]] = []
    for part in study:
        factors = [run.size_factor for run in part.runs]
        if FINE not in factors[1:] or len(set(factors)) < len(factors):
            continue
        place = factors.index(FINE)
        before, fine = results[part.runs[place - 1]], results[part.runs[place]]
        if part.runs[place].thickness == 1.0:
            limit = TARGETS["floor"]
            for key, words in (("mean_near", "mean"), ("p95_near", "95th percentile"), ("max_near", "maximum")):
                found = fine[key]
                rows.append([f"{part.name}: within {NEAR:g} mm of a rim, {words}", f"{limit:g}", found, found <= limit])
        else:
            steps = f"{before['edge']:.2f} to {fine['edge']:.2f} mm"
            for key, words, found in (
                ("force", "force", force_change(before, fine)),
                ("p95", "ε P95", change(before, fine, "p95")),
            ):
                assert found is not None
                rows.append(
                    [
                        f"{part.name}: change of {words}, {steps} (%)",
                        f"{TARGETS[key]:g} %",
                        found,
                        abs(found) <= TARGETS[key],
                    ]
                )
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


def compose(folder: Path, study: Sequence[Series], results: dict[Any, Row], rows: list[list[Any]]) -> Path:
    """The HTML report."""
    report = Report(
        "Convergence of the 3D model", "What the size of hexes, their layers and the bulk modulus are worth"
    )
    report.paragraph(
        f"The cross, {DISPLACEMENT:g} mm pulled at each arm in {INCREMENTS} increments; an eighth with Q2-P1 hexes, "
        "0.7 times as high from layer to layer towards the surface. Where nothing else is said: size factor 1, two layers of "
        "half the thickness, a bulk modulus of 10000 shear moduli. Grips 'held' hold all three components of a side; 'free' lets it contract through the thickness, as a sheet in plane stress does; where neither is said they are free. Each run is a process with one thread. Mesh sizes are "
        "measured: edges are never longer than the radius of a hole's tip, and a mesh with a bad cell is made again "
        "with sizes a little smaller. A change is against the next finer setting."
    )
    judged = targets(study, results)
    if judged:
        report.heading("Targets").table(TARGET_COLUMNS, judged)
    else:
        report.paragraph("This is a quick run: it shows the path and proves nothing about convergence.")
    for part in study:
        report.heading(part.name[0].upper() + part.name[1:])
        report.table(COLUMNS[1:], [row[1:] for row in rows if row[0] == part.name])
    report.paragraph(
        "The floor is what ε shows at a thickness where 2D and 3D should agree outside a rim's own thickness; "
        "what is left is the error of the elements. A checkerboard in the pressure would keep its jumps under refinement."
    )
    solvers = sorted({str(row["solver"]) for row in results.values()})
    report.details("Settings", {"runs": len(results), "linear solver": ", ".join(solvers)})
    return report.save(folder / "report.html")
