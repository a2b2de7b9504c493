"""How many spurious points an import finds, and how many good ones it takes for such: `python benchmarks/spurious_points.py -o FOLDER`.

In: nothing but seeds. Out: `spurious.json` with numbers and tables for docs/ugly_data.md, and its manifest. Two kinds of data:

- windows as of skin between two pads (33 x 16 points, 0.53 mm apart, 12 frames, noise of the field white or correlated over the
  distance of the points), in which clusters of points are planted that move otherwise by some standard deviations of the noise;
- simulated sheets with holes of the blind trials, with their effects and noise, and nothing planted.

Seeds from 100 on were not used while the test was made.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibrate.data.measurement import Noise
from calibrate.equations.noise_covariance import factor_of_points, sample
from studies.importers.masking.outliers import outliers
from studies.output import Manifest, write_json
from studies.trials.blind_data import draw, make

Array = NDArray[np.float64]
COLUMNS, ROWS, PITCH, FRAMES = 33, 16, 0.53, 12  # mm
NOISE = 0.012  # mm, of the last frame; it grows with the load as in filtered data
SIZES, OFFSETS = (1, 2, 4, 8, 12), (8, 15, 30)  # points of a cluster; standard deviations of the noise
CLUSTERS = 3  # in each window


def window(rng: np.random.Generator, correlated: bool) -> tuple[Array, Array]:
    """Points (n, 2) and displacements (t, n, 2), mm, of a stretched window: a smooth field of third order, and noise."""
    x, y = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
    points = PITCH * (np.column_stack([x.ravel(), y.ravel()]) + rng.uniform(-0.1, 0.1, (COLUMNS * ROWS, 2)))
    s = (points - points.mean(axis=0)) / np.ptp(points[:, 0])
    powers = np.stack([s[:, 0] ** i * s[:, 1] ** j for i in range(4) for j in range(4 - i)], axis=1)
    coefficients = rng.normal(0, 0.5, (powers.shape[1], 2))
    field = points * [0.08, -0.03] + powers @ coefficients
    load = np.linspace(0, 1, FRAMES)
    factor = factor_of_points(points, Noise(NOISE, PITCH if correlated else 0.0))
    noise = sample(factor, rng, 4)
    mixed = np.einsum("tk,knc->tnc", rng.normal(0, 0.5, (FRAMES, 4)), noise)  # errors that last for some frames
    return points, load[:, None, None] * (field + noise[0]) + 0.3 * mixed


def planted(rng: np.random.Generator, points: Array, size: int) -> NDArray[np.int64]:
    """Numbers of points of some clusters, each of neighbours."""
    centres = points[rng.choice(len(points), CLUSTERS, replace=False)]
    return np.unique(cKDTree(points).query(centres, k=size)[1])


def detection(seeds: range, size: int, offset: float, together: bool) -> tuple[int, int, int, int]:
    """Planted points, those found, good points, those taken for spurious; together: a cluster moves as one, else each point by itself."""
    counts = np.zeros(4, int)
    for seed in seeds:
        rng = np.random.default_rng(seed)
        points, u = window(rng, bool(seed % 2))
        wrong = planted(rng, points, size)
        angle = rng.uniform(0, 2 * np.pi, 1 if together else len(wrong))
        u[:, wrong] += np.linspace(0, offset * NOISE, FRAMES)[:, None, None] * np.stack(
            [np.cos(angle), np.sin(angle)], axis=-1
        )
        found = outliers(points, u).index
        hits = int(np.isin(wrong, found).sum())
        counts += len(wrong), hits, len(points) - len(wrong), len(found) - hits
    return counts[0], counts[1], counts[2], counts[3]


def false_alarms(seeds: range) -> tuple[int, int, int]:
    """Points of simulated sheets with holes, those taken for spurious, sheets with any."""
    points = alarms = sheets = 0
    for seed in seeds:
        experiment, _ = make(draw(seed))
        found = outliers(experiment.points, experiment.displacements).index
        points, alarms, sheets = points + len(experiment.points), alarms + len(found), sheets + bool(len(found))
        print(f"sheet {seed} ({experiment.provenance['specimen']}): {len(found)}", file=sys.stderr, flush=True)
    return points, alarms, sheets


def share(part: int, whole: int) -> str:
    """'97 %'; two digits below 1 %."""
    value = 100 * part / whole
    return f"{value:.2g} %" if 0 < value < 1 else f"{value:.0f} %"


def main(words: list[str] | None = None) -> int:
    """Run both and write the numbers."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("results/spurious"))
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--windows", type=int, default=4)
    parser.add_argument("--sheets", type=int, default=16)
    args = parser.parse_args(words)
    args.output.mkdir(parents=True, exist_ok=True)
    manifest = Manifest(args.first, {"windows": args.windows, "sheets": args.sheets})
    seeds = range(args.first, args.first + args.windows)
    table = [["points in a cluster", *(f"{offset} deviations, {kind}" for kind in ("as one", "each by itself") for offset in OFFSETS)]]  # fmt: skip
    good = wrong = 0
    for size in SIZES:
        cells = []
        for together in (True, False):
            for offset in OFFSETS:
                there, hits, others, alarms = detection(seeds, size, offset, together)
                cells.append(share(hits, there))
                good, wrong = good + others, wrong + alarms
        table.append([str(size), *cells])
        print(" | ".join(table[-1]), flush=True)
    clean = detection(seeds, 1, 0.0, together=True)
    points, alarms, sheets = false_alarms(range(args.first, args.first + args.sheets))
    numbers = {
        "windows": args.windows,
        "beside": f"{wrong} of {good}",
        "clean": f"{clean[1] + clean[3]} of {clean[0] + clean[2]}",
        "sheets": args.sheets,
        "sheet_points": points,
        "sheet_alarms": alarms,
        "sheets_with_alarm": sheets,
    }
    target = args.output / "spurious.json"
    how = f"seeds from {args.first}, not used while the test was made; points found of those planted, in {args.windows} windows each"
    write_json(
        target,
        {"command": "python benchmarks/spurious_points.py", "how": how, "numbers": numbers, "tables": {"found": table}},
    )
    manifest.beside(target)
    print(numbers)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
