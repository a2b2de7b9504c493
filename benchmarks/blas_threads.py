"""Threads of linear algebra in `equigap discover`, alone and beside another one: `python -m benchmarks.blas_threads`.

In: a size, points x pictures; numbers of threads. Out, in a folder: ``blas_threads.csv`` and a manifest: CPU s and wall s of the whole command for each number of threads,
alone, and of two at once (the mean of both). A run before finds compiled code for all. Run it alone on the machine.
"""

from __future__ import annotations

import argparse
import os
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from benchmarks.diagnosis import SEED, measured, simulated
from studies.commandline.threads import VARIABLE
from studies.output.folder import open_output_folder
from studies.output.manifest import Manifest
from studies.output.writing import write_csv

COLUMNS = ["points", "pictures", "threads", "at once", "run", "CPU s", "wall s"]


def at_once(experiment: Path, folder: Path, count: int) -> tuple[float, float]:
    """Mean CPU s and wall s of as many diagnoses as `count` that start together."""
    words = [
        ["discover", str(experiment), "--pictures", "all", "-o", str(folder / f"{k}"), "--overwrite"]
        for k in range(count)
    ]
    with ThreadPoolExecutor(count) as pool:
        cpu, wall, _ = np.mean(list(pool.map(measured, words)), axis=0)
    return float(cpu), float(wall)


def main() -> None:
    """Measure, and write the table after every line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("results/benchmark-blas-threads"))
    parser.add_argument("--overwrite", action="store_true", help="empty an earlier folder of this benchmark")
    parser.add_argument("--size", default="2223x26", help="points x pictures (default %(default)s)")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--runs", type=int, default=2)
    args = parser.parse_args()
    started, settings = time.time(), {"size": args.size, "threads": args.threads, "runs": args.runs}
    open_output_folder(args.output, args.overwrite, {"benchmark": "blas_threads", **settings})
    experiment, table = simulated(args.size, args.output), []
    at_once(experiment, args.output, 1)
    for run in range(1, args.runs + 1):
        for threads in args.threads:
            os.environ[VARIABLE] = str(threads)  # of the commands that are started from here
            for count in (1, 2):
                table.append(
                    [*map(int, args.size.split("x")), threads, count, run, *at_once(experiment, args.output, count)]
                )
                print("{} x {}, {} threads, {} at once, run {}: {:.0f} CPU s, {:.0f} s".format(*table[-1]), flush=True)
                write_csv(
                    args.output / "blas_threads.csv", COLUMNS, table, ["Threads of linear algebra in a diagnosis"]
                )
                Manifest(SEED, settings, started=started).beside(args.output / "blas_threads.csv")


if __name__ == "__main__":
    main()
