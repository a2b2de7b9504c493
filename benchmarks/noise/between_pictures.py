"""What changes from picture to picture of the measured sheets, by place and direction: `python -m benchmarks.noise.between_pictures`.

In: published sheets (data: `EQUIGAP_DATA`, else fetched). Out: `docs/results/between_pictures.json`: of the difference between odd pictures and the even
ones around them (`studies.sheets.measured_control`), without what is linear or quadratic over the sheet in each, the standard deviation of a reading across
and along the pull, on the two rows of points at the free edges and inside; and what it is in each direction at the edge over that inside.
"""

from __future__ import annotations

import argparse
import json
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from studies.commands.measured import COMPARED, SHEETS, neighbouring_pictures
from studies.sheets.measured_control import from_neighbours

Array = NDArray[np.float64]
INSIDE = 0.7  # of the half width and height
ROWS = ("at the free edge", "one row further in", "inside")
RESULTS = Path(__file__).parents[2] / "docs" / "results" / "between_pictures.json"


def deviations(e: Experiment) -> Array:
    """(ROWS, 2): standard deviations of one picture, um, across and along."""
    weights = from_neighbours(e)
    groups = e.displacements.reshape(-1, 5, len(e.points), 2)
    change = groups[:, 2] - np.einsum("gk,gknc->gnc", weights, groups[:, [0, 1, 3, 4]])
    change /= np.sqrt(1 + (weights**2).sum(axis=1))[:, None, None]
    place = e.points - 0.5 * (e.points.min(axis=0) + e.points.max(axis=0))
    place /= np.abs(place).max(axis=0)
    x, y = place.T
    smooth = np.linalg.qr(np.stack([x**0, x, y, x * x, x * y, y * y], axis=1))[0]
    change -= np.einsum("na,ma,gmc->gnc", smooth, smooth, change, optimize=True)
    columns = np.unique(np.abs(x).round(3))
    edge, next_to_it = (np.isclose(np.abs(x), columns[-k], atol=2e-3) for k in (1, 2))
    inside = (np.abs(place) < INSIDE).all(axis=1)
    return np.array([1e3 * np.sqrt((change[:, some] ** 2).mean(axis=(0, 1))) for some in (edge, next_to_it, inside)])


def main(output: Path) -> None:
    """Print and write the table."""
    found = {name: deviations(neighbouring_pictures(name, COMPARED)) for name in SHEETS}
    every = np.array(list(found.values()))
    numbers = {
        "edge": f"{(every[:, 0] / every[:, 2]).mean():.1f}",
        "next": f"{(every[:, 1] / every[:, 2]).mean():.1f}",
        "along": f"{(every[:, 2, 1] / every[:, 2, 0]).mean():.1f}",
    }
    head = ["sheet", *(f"{row}, {way} (um)" for row in ROWS for way in ("across", "along"))]
    content = {
        "command": "python -m benchmarks.noise.between_pictures",
        "made": datetime.now(UTC).date().isoformat(),
        "how": f"{COMPARED} odd pictures of each sheet, each with two before and two after",
        "numbers": numbers,
        "tables": {"places": [head, *([name, *(f"{v:.2f}" for v in one.ravel())] for name, one in found.items())]},
    }
    output.write_text(json.dumps(content, indent=1) + "\n")
    print(json.dumps(content["tables"], indent=1), numbers)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    main(parser.parse_args().output)
