"""A DIC export that stands in for yours: `python stand_in.py camera/experiment.npz my_test`.

Reads the Experiment of `equigap simulate` and writes what DIC software writes: one CSV a picture, the first without load,
with a confidence that is -1 where matching failed, and a table with the force at each picture.
"""

import csv
import sys
from pathlib import Path

import numpy as np

from calibrate.data.experiment import Experiment

FAILED = 12  # points that the software could not match


def main(source: str, folder: str) -> None:
    """Write frame_000.csv, ... and force.csv."""
    e = Experiment.load(source)
    out = Path(folder)
    out.mkdir(exist_ok=True)
    moved = np.concatenate([np.zeros((1, *e.points.shape)), e.displacements])
    force = [0.0, *next(b.force[:, 0] for b in e.loaded if b.name == "right")]
    inside = np.flatnonzero(np.abs(e.points[:, 0]) < 0.9 * np.abs(e.points[:, 0]).max())
    failed = np.random.default_rng(0).choice(inside, FAILED, replace=False)
    sigma = np.full(len(e.points), 0.01)
    sigma[failed] = -1.0
    for k, u in enumerate(moved):
        with (out / f"frame_{k:03d}.csv").open("w", newline="") as file:
            table = csv.writer(file)
            table.writerow(["X", "Y", "U", "V", "sigma"])
            table.writerows([[f"{v:.6f}" for v in row] for row in np.column_stack([e.points, u, sigma])])
    with (out / "force.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["Load"])
        table.writerows([[f"{f / 1000:.9f}"] for f in force])


if __name__ == "__main__":
    main(*sys.argv[1:])
