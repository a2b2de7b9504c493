"""Strain that measured sheets have at no load, before any model: `python -m benchmarks.strain_at_rest`.

In: published sheets (data: `EQUIGAP_DATA`, else fetched). Out: `docs/results/strain_at_rest.json`: in bands along the pull, bottom first, the axial strain
that a parabola in the elongation leaves at none, from the pictures between 0.5 and 12 s. A pattern that sheets of different stiffness share is no stress.
"""

from __future__ import annotations

import argparse
import json
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.equations import recovery
from studies.commands.import_data import Frames, import_experiment
from studies.commands.measured import SHEETS

Array = NDArray[np.float64]
PICTURES, FIRST, LAST, BANDS = 60, 0.5, 12.0, 7  # s
RESULTS = Path(__file__).parents[1] / "docs" / "results" / "strain_at_rest.json"


def strain_at_rest(e: Experiment) -> Array:
    """Axial strain (BANDS,) at no elongation, the mean over each band."""
    assert e.time is not None
    early = e.time > FIRST
    bottom, top = (e.displacements[:, boundary.nodes, 1].mean(axis=1) for boundary in e.loaded)
    powers = (top - bottom)[early, None] ** np.arange(3)
    strain = (recovery.centroid_gradients(e.points, e.triangles) @ e.displacements[..., 1].T)[1::2]
    y = e.points[e.triangles].mean(axis=1)[:, 1]
    low, high = e.points[:, 1].min(), e.points[:, 1].max()
    band = np.minimum((BANDS * (y - low) / (high - low)).astype(int), BANDS - 1)
    mean = np.stack([strain[band == b].mean(axis=0) for b in range(BANDS)], axis=1)
    return np.asarray(np.linalg.lstsq(powers, mean[early], rcond=None)[0][0])


def main(output: Path) -> None:
    """Print and write the table."""
    found = {name: strain_at_rest(import_experiment(name, frames=Frames(PICTURES, until=LAST))) for name in SHEETS}
    rows = [[name, *(f"{100 * v:+.2f} %" for v in values)] for name, values in found.items()]
    profiles = np.stack(list(found.values()))
    numbers = {
        "largest": f"{100 * np.abs(profiles).max():.1f} %",
        "correlation_of_homogeneous": f"{np.corrcoef(profiles[:2])[0, 1]:.2f}",
    }
    content = {
        "command": "python -m benchmarks.strain_at_rest",
        "made": datetime.now(UTC).date().isoformat(),
        "how": f"parabola in the elongation, {PICTURES} pictures from {FIRST:g} to {LAST:g} s",
        "numbers": numbers,
        "tables": {"bands": [["sheet", *(f"band {b + 1}" for b in range(BANDS))], *rows]},
    }
    output.write_text(json.dumps(content, indent=1) + "\n")
    print(json.dumps(content["tables"], indent=1), numbers)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    main(parser.parse_args().output)
