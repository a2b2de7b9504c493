"""Look of all figures: colour-blind safe colours, one meaning per colour, readable in print.

Nothing is switched at import: draw inside `with style.figure(...) as figure:`. Colours after Okabe and Ito
(2008), distinct for all common kinds of colour vision; curves differ in line style as well, so that they
survive grey print.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

COLOURS = {
    "blue": "#0072B2",
    "orange": "#E69F00",
    "green": "#009E73",
    "vermilion": "#D55E00",
    "purple": "#CC79A7",
    "sky": "#56B4E9",
    "yellow": "#F0E442",
    "black": "#000000",
}
MODES: dict[str, dict[str, Any]] = {
    "uniaxial": {"color": COLOURS["blue"], "linestyle": "-", "label": "uniaxial"},
    "equibiaxial": {"color": COLOURS["vermilion"], "linestyle": "--", "label": "equi-biaxial"},
    "pure_shear": {"color": COLOURS["green"], "linestyle": "-.", "label": "pure shear"},
}
SEQUENTIAL, DIVERGING = "cividis", "PuOr"
RC = {
    "axes.prop_cycle": cycler(
        color=[COLOURS[name] for name in ("blue", "vermilion", "green", "purple", "orange", "sky", "black")],
        linestyle=["-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1))],
    ),
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.6,
    "font.size": 9,
    "axes.titlesize": 9,
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "image.cmap": SEQUENTIAL,
    "savefig.dpi": 160,
    "svg.hashsalt": "equigap",
}


def over(time: NDArray[np.float64] | None, count: int) -> tuple[NDArray[np.float64], str]:
    """Where `count` increments are drawn, and the label of that axis: time (t,), s, or their numbers from 1."""
    return (np.arange(1.0, count + 1), "increment") if time is None else (time, "time, s")


@contextmanager
def figure(width: float = 6.4, height: float = 4.0) -> Iterator[Figure]:
    """A figure of width and height in inches, in this style; needs no screen. Save it inside the block."""
    with mpl.rc_context(RC):
        yield Figure(figsize=(width, height), layout="constrained")


def mark_range(axes: Axes, low: float, high: float, label: str | None = "calibrated range") -> None:
    """Shade [low, high] on the x-axis: where the data support the prediction."""
    axes.axvspan(low, high, color=COLOURS["sky"], alpha=0.15, linewidth=0, label=label)
    axes.axvline(high, color=COLOURS["sky"], linewidth=0.8, linestyle="-")
