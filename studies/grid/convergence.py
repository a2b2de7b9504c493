"""`equigap thickness --convergence`: what the size of hexes, their layers and the bulk modulus are worth.

In: a folder. Out: one small JSON a run, ``convergence.csv``, ``convergence.md``, a report. A killed study goes on with the
runs that are missing.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from studies.grid import convergence_report
from studies.grid.convergence_runs import DISPLACEMENT, INCREMENTS, result_path, series, start
from studies.output import open_output_folder, track


def run_convergence(folder: Path, quick: bool = False, overwrite: bool = False) -> Path:
    """Run what is missing, write tables and report; returns the path of that. Raises `WorkflowError` where a run fails."""
    study = series(quick)
    runs = list(dict.fromkeys(run for part in study for run in part.runs))
    settings = {"study": "thickness convergence", "runs": [asdict(run) for run in runs],
                "displacement": DISPLACEMENT, "increments": INCREMENTS}  # fmt: skip
    folder = open_output_folder(folder, overwrite, settings)
    for run in track(runs, "convergence", unit="runs"):
        if not result_path(folder, run).exists():
            start(folder, run)
    return convergence_report.write(folder, study)
