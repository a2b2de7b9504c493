"""Cost of `equigap discover` and `equigap calibrate`, and how it grows with points and pictures: `python benchmarks/diagnosis.py`.

In: sizes, points x pictures (--sizes; --large adds 20,000 x 100). Each is a cross of Mooney-Rivlin rubber, solved with biquadratic quads and seen with
noise, so that a diagnosis adds one effect, the second invariant. Out, in a folder: ``cost.csv`` and a manifest: for each size and command CPU s, wall s
and the peak of memory of the whole command, from start to report, twice: the second run finds compiled code. Run it alone on the machine.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

from studies.output.folder import open_output_folder
from studies.output.manifest import Manifest
from studies.output.writing import write_csv

SIZES = ("550x26", "1100x26", "2223x13", "2223x26", "2223x52", "2223x104", "4450x26")
LARGE = "20000x100"
CALIBRATED = "20000x10"
COLUMNS = ["command", "points", "pictures", "run", "CPU s", "wall s", "peak GB", "found"]
SEED, DISPLACEMENT = 3, 40.0


def measured(words: list[str]) -> tuple[float, float, float]:
    """CPU s, wall s and peak memory, GB, of a command of equigap. Raises `SystemExit` where it fails."""
    began = time.perf_counter()
    process = subprocess.Popen([sys.executable, "-m", "studies.cli", *words], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"equigap {' '.join(words)} failed; try it by itself")
    return usage.ru_utime + usage.ru_stime, time.perf_counter() - began, usage.ru_maxrss / 1e6


def simulated(size: str, folder: Path) -> Path:
    """The Experiment of a size, made if it is not there."""
    points, pictures = size.split("x")
    made = folder / "tests" / size
    if not (made / "experiment.npz").is_file():
        words = ["--material", "mooney_rivlin", "--displacement", str(DISPLACEMENT), "--seed", str(SEED)]
        measured(["simulate", *words, "--nodes", points, "--increments", pictures, "-o", str(made), "--overwrite"])
    return made / "experiment.npz"


def rows(command: str, size: str, folder: Path, runs: int) -> list[list[object]]:
    """A line of the table for each run."""
    experiment, found = simulated(size, folder), []
    for run in range(1, runs + 1):
        out = folder / f"{command}-{size}"
        cost = measured([command, str(experiment), "--pictures", "all", "-o", str(out), "--overwrite"])
        verdict = json.loads((out / "discovery.json").read_text())["verdict"] if command == "discover" else ""
        found.append([command, *map(int, size.split("x")), run, *cost, verdict])
        print("{} {} x {}, run {}: {:.0f} CPU s, {:.0f} s, {:.2f} GB {}".format(*found[-1]), flush=True)
    return found


def main() -> None:
    """Measure, and write the table after every size."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("results/benchmark-diagnosis"))
    parser.add_argument("--overwrite", action="store_true", help="empty an earlier folder of this benchmark")
    parser.add_argument("--sizes", nargs="*", default=SIZES, help="points x pictures (default %(default)s)")
    parser.add_argument("--large", action="store_true", help=f"also {LARGE}, and calibrate {CALIBRATED}")
    parser.add_argument("--runs", type=int, default=2)
    args = parser.parse_args()
    started, settings = time.time(), {"sizes": list(args.sizes), "large": args.large, "runs": args.runs}
    open_output_folder(args.output, args.overwrite, {"benchmark": "diagnosis", **settings})
    cases = [("discover", size) for size in args.sizes]
    cases += [("calibrate", CALIBRATED), ("discover", LARGE)] if args.large else []
    table: list[list[object]] = []
    for command, size in cases:
        table += rows(command, size, args.output, args.runs)
        write_csv(args.output / "cost.csv", COLUMNS, table, ["Cost of a diagnosis and of a calibration"])
        Manifest(SEED, settings, started=started).beside(args.output / "cost.csv")


if __name__ == "__main__":
    main()
