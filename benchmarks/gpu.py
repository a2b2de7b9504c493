"""What a GPU is worth: calibration and diagnosis with JAX on the processor and on the graphics card of one machine.

    equigap simulate --nodes 20000 --increments 10 -o large
    python -m benchmarks.gpu calibrate:large/experiment.npz discover:small/experiment.npz [--output FOLDER]

In: tasks, COMMAND:EXPERIMENT. Out: a table, and ``gpu.json``: wall s, CPU s, peak memory of every task on either, and by how much the numbers differ
that it finds. Needs JAX with a GPU; no finite-element package, so that a diagnosis is without twin and replays, and is of the rounds alone.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import jax

from calibrate.data.experiment import Experiment
from calibrate.diagnosis.discovery import discover
from calibrate.fitting.calibration import calibrate
from studies.output.run_progress import RunProgress
from studies.output.writing import write_json

PLATFORMS = {"CPU": "cpu", "GPU": "cuda"}
COLUMNS = [
    "command",
    "points",
    "pictures",
    "JAX on",
    "threads of linear algebra",
    "wall s",
    "CPU s",
    "peak GB",
    "found",
    "largest relative difference",
]


def calibrated(path: Path) -> dict[str, Any]:
    """Loss and forces of the default network."""
    experiment = Experiment.load(path)
    found = calibrate(experiment)
    return {
        "found": f"PANN_{found.options.inputs}",
        "numbers": [found.loss, *(float(v) for f in found.predicted_forces.values() for v in f[-1])],
        "size": [len(experiment.points), experiment.n_increments],
    }


def discovered(path: Path) -> dict[str, Any]:
    """Effects of the final model, their amplitudes, and its chi-square."""
    experiment = Experiment.load(path)
    found = discover([experiment], fitted=False, say=RunProgress())
    final = found.final
    return {
        "found": f"{found.verdict}: {', '.join(final.names) or 'none'}",
        "numbers": [final.free_loss, *(v for a in final.additions for v in a.amplitudes)],
        "size": [len(experiment.points), experiment.n_increments],
    }


TASKS = {"calibrate": calibrated, "discover": discovered}


def alone(task: str, path: Path) -> dict[str, Any]:
    """A task in this process, with what it cost from the start of the process on."""
    found = TASKS[task](path)
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return {
        **found,
        "device": jax.devices()[0].device_kind,
        "cpu": usage.ru_utime + usage.ru_stime,
        "memory": usage.ru_maxrss / 1e6,
    }


def measured(task: str, path: Path, platform: str) -> dict[str, Any]:
    """A task in a process of its own, with JAX on one platform. Raises `SystemExit` where it fails."""
    began = time.perf_counter()
    words = [sys.executable, "-m", "benchmarks.gpu", "--alone", f"{task}:{path}"]
    done = subprocess.run(words, env={**os.environ, "JAX_PLATFORMS": platform}, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        raise SystemExit(f"{task} of {path} with JAX on {platform} failed: is there a GPU that JAX sees?")
    return {**json.loads(done.stdout.splitlines()[-1]), "wall": time.perf_counter() - began}


def difference(one: list[float], other: list[float]) -> float:
    """Largest, over the largest number; infinite where not the same numbers were found."""
    if len(one) != len(other):
        return float("inf")
    return max(abs(a - b) / max(abs(a), abs(b), 1e-300) for a, b in zip(one, other, strict=True))


def main() -> None:
    """Print the table as it grows, and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", help="COMMAND:EXPERIMENT")
    parser.add_argument("--output", type=Path, default=Path("results/benchmarks"))
    parser.add_argument("--alone", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.alone:
        print(json.dumps(alone(*_split(given.alone))))
        return
    threads = os.environ.get("OPENBLAS_NUM_THREADS", f"all {os.cpu_count()}")
    rows: list[list[Any]] = []
    for task, path in map(_split, given.tasks):
        first: list[float] = []
        for name, platform in PLATFORMS.items():
            one = measured(task, path, platform)
            first = first or one["numbers"]
            cost = [round(one[key], 2) for key in ("wall", "cpu", "memory")]
            rows.append(
                [
                    task,
                    *one["size"],
                    f"{name} ({one['device']})",
                    threads,
                    *cost,
                    one["found"],
                    difference(first, one["numbers"]),
                ]
            )
            print(*rows[-1], sep="  ", flush=True)
            write_json(given.output / "gpu.json", {"columns": COLUMNS, "rows": rows})


def _split(word: str) -> tuple[str, Path]:
    task, _, path = word.partition(":")
    if task not in TASKS:
        raise SystemExit(f"{word}: give {' or '.join(TASKS)}, a colon, and an Experiment")
    return task, Path(path)


if __name__ == "__main__":
    main()
