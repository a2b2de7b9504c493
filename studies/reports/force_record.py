"""Forces of the grips, measured and predicted, increment by increment: rows of a table, and which of them to draw.

In: {boundary: (t, 2)} N. Out: columns and rows; boundaries and components that carry a force worth drawing.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
COMPONENTS = ("x", "y")
NEGLIGIBLE = 0.05  # force components below this share of the largest are in the table only


def rows(
    measured: Mapping[str, Array],
    predicted: Mapping[str, Array],
    time: Array | None,
    fitted: NDArray[np.bool_] | None = None,
) -> tuple[list[str], list[list[Any]]]:
    """Every increment with its forces, N, its time, s (empty where there is none), and whether it was fitted, where given."""
    pairs = [(name, k) for name in predicted for k in (0, 1)]
    columns = ["increment", "time", *(["fitted"] if fitted is not None else [])]
    columns += [f"{name}_{COMPONENTS[k]}_{kind}" for name, k in pairs for kind in ("measured", "predicted")]
    content = []
    for i in range(len(next(iter(predicted.values())))):
        line: list[Any] = [i + 1, None if time is None else float(time[i])]
        line += [] if fitted is None else [int(fitted[i])]
        content.append(line + [float(f[name][i, k]) for name, k in pairs for f in (measured, predicted)])
    return columns, content


def worth_drawing(measured: Mapping[str, Array]) -> list[tuple[str, int]]:
    """Boundaries and components (0: x, 1: y) with forces above `NEGLIGIBLE` of the largest; one at least."""
    sizes = {(name, k): float(np.nanmax(np.abs(f[:, k]), initial=0.0)) for name, f in measured.items() for k in (0, 1)}
    return [pair for pair, size in sizes.items() if size >= NEGLIGIBLE * max(sizes.values())] or [next(iter(sizes))]
