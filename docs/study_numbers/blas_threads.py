"""Threads of linear algebra in a diagnosis: ``blas_threads.csv`` of `python -m benchmarks.blas_threads`."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any


def take(folder: Path) -> dict[str, Any]:
    """A table of every run."""
    with (folder / "blas_threads.csv").open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    cases: dict[tuple[str, str], list[dict[str, str]]] = {}
    for row in rows:
        cases.setdefault((row["threads"], row["at once"]), []).append(row)
    table = [
        [*case, *(", ".join(f"{float(row[unit]):.0f}" for row in found) for unit in ("CPU s", "wall s"))]
        for case, found in sorted(cases.items(), key=lambda one: one[0][::-1])
    ]
    return {
        "command": "python -m benchmarks.blas_threads",
        "how": f"{rows[0]['points']} points, {rows[0]['pictures']} pictures, one effect added, on two cores; every run",
        "numbers": {},
        "tables": {"cost": [["threads", "diagnoses at once", "CPU s of each", "wall s"], *table]},
    }
