"""How fine the mesh of a replay is: `python benchmarks/replay_mesh.py`.

In: nothing; one blind test without an effect of every specimen. Out: `docs/results/replay_mesh.json`. Each is replayed with a law of Arruda and Boyce on the mesh of a
replay, and with the camera's triangles divided in four and in sixteen before; the last is the reference. Errors of displacements at the camera's points, mm, and of
forces, CPU s; one solution is made before, so that compiled code is there.
"""

from __future__ import annotations

import json
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from forward.materials import ArrudaBoyce
from forward.sheet.inelastic import solve_history
from forward.sheet.sheet_run import Options
from forward.sheet.thin_sheet import Sheet
from forward.solution import SurfaceSolution
from studies.replay.replayed_experiment import TOLERANCE, BoundaryValues
from studies.trials.blind_data import draw, make
from studies.trials.blind_trial import SPECIMENS, Trial

Array = NDArray[np.float64]
RESULTS = Path(__file__).parents[1] / "docs" / "results" / "replay_mesh.json"
SEED, FINEST = 0, 2
HEAD = ["specimen", "camera points", "triangles divided before", "unknowns", "displacements off by, mm (rms)", "relative", "at most", "over the noise", "forces off by", "CPU s"]  # fmt: skip


def trial_on(specimen: str) -> Trial:
    """The first seed whose test without an effect is on a specimen."""
    return next(t for t in (draw(seed, None) for seed in range(SEED, SEED + 100)) if t.specimen == specimen)


def solved(experiment: Experiment, finer: int) -> tuple[SurfaceSolution, float]:
    """The replay on a mesh, and its CPU time, s."""
    problem = BoundaryValues.of(experiment, finer)
    sheet = Sheet(ArrudaBoyce(0.4, 12.0), experiment.thickness or 1.0)
    factors = np.arange(1, experiment.n_increments + 1) / experiment.n_increments
    times = factors if experiment.time is None else experiment.time
    motion = problem.motion(experiment.displacements)
    began = time.process_time()
    found = solve_history(problem.mesh, sheet, motion, factors, times, options=Options(TOLERANCE))
    return found, time.process_time() - began


def rows_of(specimen: str) -> list[dict[str, Any]]:
    """One of each mesh."""
    trial = trial_on(specimen)
    experiment = make(trial)[0]
    n = len(experiment.points)
    solved(experiment, 0)
    found = {finer: solved(experiment, finer) for finer in range(FINEST + 1)}
    best = found[FINEST][0]
    rows = []
    for finer, (one, seconds) in found.items():
        wrong = one.displacements[:, :n] - best.displacements[:, :n]
        forces = [np.concatenate([np.ravel(s.reactions[name]) for name in best.reactions]) for s in (one, best)]
        rows.append({
            "specimen": specimen, "points": n, "finer": finer, "unknowns": 2 * len(one.points),
            "rms": float(np.sqrt((wrong[-1] ** 2).mean())), "most": float(np.abs(wrong).max()),
            "relative": float(np.sqrt((wrong[-1] ** 2).sum() / (best.displacements[-1, :n] ** 2).sum())),
            "noises": float(np.sqrt((wrong[-1] ** 2).mean()) / trial.displacement_std),
            "force": float(np.linalg.norm(forces[0] - forces[1]) / np.linalg.norm(forces[1])), "seconds": seconds,
        })  # fmt: skip
    return rows


def line(row: dict[str, Any]) -> list[str]:
    """As the page shows it."""
    size = [row["specimen"], str(row["points"]), f"{row['finer']} times", f"{row['unknowns']:,}"]
    if row["finer"] == FINEST:
        return [*size, "reference", "", "", "", "", f"{row['seconds']:.1f}"]
    return [*size, f"{row['rms']:.1e}", f"{row['relative']:.1e}", f"{row['most']:.1e}", f"{row['noises']:.2f}", f"{100 * row['force']:.4f} %", f"{row['seconds']:.1f}"]  # fmt: skip


if __name__ == "__main__":
    rows = []
    for name in SPECIMENS:
        rows += rows_of(name)
        print(*(line(row) for row in rows[-3:]), sep="\n", flush=True)
    used = [row for row in rows if row["finer"] == 0]
    content = {
        "command": "python benchmarks/replay_mesh.py",
        "made": datetime.now(UTC).date().isoformat(),
        "numbers": {
            "rms": max(row["rms"] for row in used),
            "relative": max(row["relative"] for row in used),
            "noises": max(row["noises"] for row in used),
            "force": max(row["force"] for row in used),
        },
        "tables": {"meshes": [HEAD, *(line(row) for row in rows)]},
    }
    RESULTS.write_text(json.dumps(content, indent=1) + "\n")
