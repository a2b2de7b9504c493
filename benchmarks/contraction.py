"""Contraction in the middle of a clamped sheet, measured and replayed: `python benchmarks/contraction.py`.

In: a published sheet (`equigap import Soft_Homo`; data: `EQUIGAP_DATA`, else fetched). Out: `docs/results/contraction.json`,
the exponent -ln(stretch across) / ln(stretch along), means over a window in the middle, at some times, of the measured displacements
and of those of an incompressible neo-Hookean sheet of the same size in plane stress whose grips move as measured.

The modulus does not matter: both grips are prescribed, so that the displacements do not depend on it.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.equations import recovery
from forward import Loading, NeoHooke
from forward.loading import BoundedMesh
from forward.sheet.plane_stress import solve
from meshes import PureShearSheet, quads
from studies.commands.import_data import Frames, import_experiment

Array = NDArray[np.float64]
WINDOWS = (0.1, 0.2, 0.3)  # half the window over the extent; 0.2 is that of `equigap measured`
GRIPS = ("bottom", "top")
RESULTS = Path(__file__).parents[1] / "docs" / "results" / "contraction.json"


@dataclass(frozen=True)
class MeasuredGrips(Loading):
    """Grips whose nodes move as measured: paths, side to (x (k,), u (k, 2)), mm."""

    paths: dict[str, tuple[Array, Array]]

    def on(self, mesh: BoundedMesh) -> Loading:
        return self

    def prescribed(self, mesh: BoundedMesh) -> tuple[NDArray[np.bool_], Array]:
        held, values = np.zeros(mesh.points.shape, bool), np.zeros(mesh.points.shape)
        for side, (x, u) in self.paths.items():
            nodes = mesh.boundary_nodes(side)
            held[nodes] = True
            values[nodes] = np.stack([np.interp(mesh.points[nodes, 0], x, u[:, i]) for i in range(2)], axis=1)
        return held, values


def replayed(e: Experiment, increment: int, size: float) -> Array:
    """Displacements (n, 2), mm, of the neo-Hookean sheet at the measured points; size: of the quads, mm."""
    low, high = e.points.min(axis=0), e.points.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    sheet = PureShearSheet(half_length=half[0], half_width=half[1], far_size=size)
    sides = {boundary.name: boundary.nodes for boundary in e.loaded}
    order = {side: nodes[np.argsort(e.points[nodes, 0])] for side, nodes in sides.items()}
    paths = {side: (e.points[nodes, 0] - middle[0], e.displacements[increment, nodes]) for side, nodes in order.items()}
    loading = MeasuredGrips(dict.fromkeys(GRIPS, (0.0, 0.0)), paths)
    seen = np.clip(e.points - middle, -half, half)
    return solve(quads(sheet), NeoHooke(1.0), loading, n_increments=4).evaluate(seen)[-1]


def exponent(e: Experiment, u: Array, window: float) -> float:
    """-ln(stretch across) / ln(stretch along), from mean displacement gradients in the window; u: (n, 2), mm."""
    gradient = recovery.centroid_gradients(e.points, e.triangles)
    low, high = e.points.min(axis=0), e.points.max(axis=0)
    centre = e.points[e.triangles].mean(axis=1)
    inside = (np.abs(centre - 0.5 * (low + high)) < window * (high - low)).all(axis=1)
    across, along = (gradient @ u[:, 0])[0::2][inside].mean(), (gradient @ u[:, 1])[1::2][inside].mean()
    return float(-np.log1p(across) / np.log1p(along))


def compare(name: str, frames: int, size: float) -> list[dict[str, Any]]:
    """A row for each time and window."""
    e = import_experiment(name, frames=Frames(frames))
    assert e.time is not None
    rows = []
    for k in range(e.n_increments):
        model = replayed(e, k, size)
        for window in WINDOWS:
            row = {"time": float(e.time[k]), "window": window}
            row |= {"measured": exponent(e, e.displacements[k], window), "replayed": exponent(e, model, window)}
            rows.append(row)
            print(" ".join(f"{key} {value:.3f}" for key, value in row.items()), flush=True)
    return rows


def content(name: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """What is written: the ranges over times and windows, a table, and how it was made."""
    kinds = ("measured", "replayed")
    numbers = {f"{kind}_{end.__name__}": end(row[kind] for row in rows) for kind in kinds for end in (min, max)}
    gaps = [row["replayed"] - row["measured"] for row in rows]
    numbers |= {"difference_min": min(gaps), "difference_max": max(gaps)}
    head = ["time (s)", *(f"{kind}, {200 * w:.0f} % of the extent" for w in WINDOWS for kind in kinds)]
    times = sorted({row["time"] for row in rows})
    cells = {(row["time"], row["window"], kind): f"{row[kind]:.3f}" for row in rows for kind in kinds}
    body = [[f"{t:.1f}", *(cells[t, w, kind] for w in WINDOWS for kind in kinds)] for t in times]
    return {
        "command": f"python -m benchmarks.contraction {name}",
        "made": datetime.now(UTC).date().isoformat(),
        "how": "neo-Hooke in plane stress, incompressible, both grips displaced as measured, node by node",
        "numbers": numbers,
        "tables": {"exponent": [head, *body]},
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", nargs="?", default="Soft_Homo")
    parser.add_argument("--frames", type=int, default=6)
    parser.add_argument("--size", type=float, default=2.0, help="of the quads, mm")
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    args = parser.parse_args()
    found = content(args.name, compare(args.name, args.frames, args.size))
    args.output.write_text(json.dumps(found, indent=1) + "\n")
