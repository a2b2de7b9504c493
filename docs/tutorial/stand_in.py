"""An export that stands in for yours: `python stand_in.py camera/experiment.npz my_test`.

Reads the Experiment of `equigap simulate` and writes the folder that MatchID 2D writes: one table a picture, the first without
load, with named columns, semicolons and y downwards, numbers missing where matching failed, and `Image.csv` with the force.
"""

import sys
from pathlib import Path

import numpy as np

from calibrate.data.experiment import Experiment

FAILED = 12  # points that the software could not match
PERIOD = 2.0  # s between pictures
COLUMNS = (
    "coor.X [mm]",
    "coor.Y [mm]",
    "disp.Horizontal Displacement U [mm]",
    "disp.Vertical Displacement V [mm]",
)


def main(source: str, folder: str) -> None:
    """Write Image_0000_0.tif.csv, ... and Image.csv."""
    e = Experiment.load(source)
    out = Path(folder)
    out.mkdir(exist_ok=True)
    inside = np.flatnonzero(np.abs(e.points[:, 0]) < 0.9 * np.abs(e.points[:, 0]).max())
    failed = np.random.default_rng(0).choice(inside, FAILED, replace=False)
    force = [0.0, *next(b.force[:, 0] for b in e.loaded if b.name == "right")]
    down = np.array([1.0, -1.0])
    rows = ["File;TimeStamp; Force [N]"]
    for k, u in enumerate(np.concatenate([np.zeros((1, *e.points.shape)), e.displacements])):
        moved = u * down
        moved[failed] = np.nan
        picture = f"Image_{k:04d}_0.tif"
        write(out / f"{picture}.csv", np.column_stack([e.points * down, moved]))
        rows.append(f"{picture};{PERIOD * k:.3f}; {force[k]:.6f}")
    (out / "Image.csv").write_text("\n".join(rows) + "\n")


def write(path: Path, table: np.ndarray) -> None:
    """One picture (n, 4)."""
    lines = [";".join(COLUMNS), *(";".join(f"{value:.9E}" for value in row) for row in table)]
    path.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
