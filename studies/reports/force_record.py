"""Forces of the grips, measured and predicted, increment by increment: rows of a table, and a figure.

In: {boundary: (t, 2)} N. Out: columns and rows; which boundaries and components carry a force worth drawing; the figure of these.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from studies.output import style

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


def draw(
    measured: Mapping[str, Array], found: Mapping[str, Array], time: Array | None, label: str, marks: str = "o"
) -> Figure:
    """Forces over time, s, or increments, differences below; components that carry next to nothing are left out. label: of `found`; marks: of what was
    measured, a line where there are many."""
    panels = worth_drawing(measured)
    x, over = style.over(time, len(next(iter(found.values()))))
    with style.figure(max(4.8, 3.0 * len(panels)), 4.4) as figure:
        axes = figure.subplots(2, len(panels), squeeze=False, sharex=True, height_ratios=(2, 1.2))
        for (top, bottom), (name, k) in zip(axes.T, panels, strict=True):
            top.plot(x, measured[name][:, k], marks, color="black", mfc="none", label="measured")
            top.plot(x, found[name][:, k], color=style.COLOURS["blue"], label=label)
            bottom.plot(
                x, found[name][:, k] - measured[name][:, k], "-" if marks == "-" else ".-", color=style.COLOURS["blue"]
            )
            bottom.axhline(0, color="0.4", lw=0.6)
            top.set_title(f"{name} edge, {COMPONENTS[k]}")
            bottom.set_xlabel(over)
        axes[0, 0].set_ylabel("force on the specimen, N")
        axes[1, 0].set_ylabel(f"{label} - measured, N")
        axes[0, 0].legend()
    return figure
