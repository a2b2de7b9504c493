"""Draw the picture of a window in a larger body: `python docs/ugly_pictures.py`.

In: nothing. Out: `window.png` in docs/pictures and its manifest.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Polygon, Rectangle

from studies.output import Manifest, style, write_figure

TARGET = Path(__file__).resolve().parent / "pictures" / "window.png"
PADS, WINDOW = ((-18.0, -10.0), (10.0, 18.0)), (-6.5, 6.5)  # mm along the pull
HALF_HEIGHT = 4.0  # mm, of pads and window
BODY = (26.0, 11.0)  # mm, half axes of what is drawn of the body


def draw() -> Figure:
    """Body, pads, window, and how the force goes from one pad to the other."""
    with style.figure(8.0, 3.6) as figure:
        axes = figure.subplots()
        angle = np.linspace(0, 2 * np.pi, 200)
        wavy = 1 + 0.03 * np.sin(7 * angle) + 0.02 * np.cos(5 * angle)
        axes.add_patch(Polygon(np.column_stack([BODY[0] * wavy * np.cos(angle), BODY[1] * wavy * np.sin(angle)]), facecolor="0.95", edgecolor="0.7"))  # fmt: skip
        _force_lines(axes)
        for (left, right), sign in zip(PADS, (-1, 1), strict=True):
            axes.add_patch(Rectangle((left, -HALF_HEIGHT), right - left, 2 * HALF_HEIGHT, facecolor="0.6", zorder=3))
            axes.text((left + right) / 2, 0, "pad", ha="center", va="center", zorder=4)
            _arrow(axes, (sign * 18.0, 0.0), (sign * 23.5, 0.0), style.COLOURS["vermilion"])
            axes.text(sign * 21.0, 0.8, "F", ha="center", color=style.COLOURS["vermilion"])
        _window(axes)
        axes.set(aspect="equal", xlim=(-27.5, 27.5), ylim=(-12.6, 12))
        axes.axis("off")
    return figure


def _force_lines(axes: Axes) -> None:
    """From pad to pad, through the window and past it."""
    x = np.linspace(PADS[0][1], PADS[1][0], 80)
    for start in np.linspace(-3.5, 3.5, 8):
        y = start * (1 + 0.9 * np.cos(np.pi * x / 20.0) ** 2)
        axes.plot(x, y, color=style.COLOURS["blue"], linewidth=0.8, linestyle="-", zorder=1)


def _window(axes: Axes) -> None:
    """Points of the camera; loaded edges as squares, the others with an unknown traction."""
    low, high = WINDOW
    x, y = np.meshgrid(np.linspace(low, high, 17), np.linspace(-HALF_HEIGHT, HALF_HEIGHT, 10))
    axes.plot(x.ravel(), y.ravel(), ".", color="black", markersize=2, zorder=2)
    for side in WINDOW:
        axes.plot(np.full(10, side), y[:, 0], "s", color=style.COLOURS["vermilion"], markersize=4, zorder=3)
    for sign in (-1, 1):
        for place in np.linspace(low, high, 7)[1:-1]:
            _arrow(axes, (place, sign * HALF_HEIGHT), (place, sign * (HALF_HEIGHT + 2.0)), "0.35")
        text = "unknown traction: no equation there"
        axes.text(0, sign * (HALF_HEIGHT + 3.1), text, ha="center", va="center", color="0.25")
    axes.text(
        0, -11.9, "blue: the force flows through the window and past it", ha="center", color=style.COLOURS["blue"]
    )


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], colour: str) -> None:
    axes.add_patch(FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=9, color=colour, zorder=5))


if __name__ == "__main__":
    manifest = Manifest()
    write_figure(TARGET, draw(), dpi=130)
    manifest.beside(TARGET)
