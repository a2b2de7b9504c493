"""Figures of the comparison with NN-EUCLID: loss over time, and the stress of each model on the six paths.

In: the dicts of `side_by_side.compare`. Out: matplotlib figures.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from beside.nn_euclid_data import GAMMA, PATHS, SEEN, TITLES
from matplotlib.axes import Axes

from studies.output import style

COMPONENT = {"SS": "$P_{12}$", "PS": "$P_{22}$"}
LINES = {
    "truth": ("0.6", "-", 4.0),
    "equigap, I1": ("sky", "--", 1.4),
    "equigap, I1I2": ("blue", "-", 1.4),
    "Ogden, one term": ("green", "-.", 1.2),
    "two fibres (Holzapfel)": ("purple", "-.", 1.2),
    "NN-EUCLID": ("vermilion", ":", 2.0),
}


def colour(name: str) -> str:
    """Of a model."""
    key = LINES[name][0]
    return style.COLOURS.get(key, key)


def loss_over_time(cases: list[dict[str, Any]]) -> Any:
    """NN-EUCLID's loss of every model over CPU time, one panel a case."""
    with style.figure(3.4 * len(cases), 3.6) as figure:
        panels = np.atleast_1d(figure.subplots(1, len(cases), sharey=True))
        for axes, case in zip(panels, cases, strict=True):
            _losses(axes, case)
        panels[0].set_ylabel("loss of NN-EUCLID, squared force")
        panels[-1].legend(fontsize=7)
    return figure


def _losses(axes: Axes, case: dict[str, Any]) -> None:
    peer = case["peer"]
    if peer:
        times, losses = ([row[key] for row in peer] for key in ("cpu_seconds", "loss"))
        axes.plot(times, losses, "o-", ms=3, color=colour("NN-EUCLID"), label="NN-EUCLID, one member")
    for name in ("equigap, I1", "equigap, I1I2", "Ogden, one term", "two fibres (Holzapfel)"):
        rows = [row for row in case["models"] if row["name"] == name]
        if rows:
            times, losses = ([row[key] for row in rows] for key in ("cpu_seconds", "loss"))
            axes.plot(times, losses, "s", ms=6, color=colour(name), label=name)
    truth = next(row for row in case["models"] if row["name"] == "truth")
    axes.axhline(truth["loss"], color=colour("truth"), lw=3, zorder=0, label="the exact law")
    axes.set(xscale="log", yscale="log", xlabel="CPU time, s", title=f"{case['material']}, noise {case['noise']}")


def paths(case: dict[str, Any]) -> Any:
    """Stress of each model on the six paths; the range that the test reached is shaded."""
    with style.figure(9.5, 5.6) as figure:
        panels = figure.subplots(2, 3)
        rows = list(case["models"]) + case["peer"][-1:]
        for axes, path in zip(panels.ravel(), PATHS, strict=True):
            axes.axvspan(0, SEEN, color="0.93", zorder=0)
            for name, (_, line, width) in LINES.items():
                row = next((row for row in rows if row["name"] == name), None)
                if row is not None:
                    axes.plot(GAMMA, row["curves"][path], line, lw=width, color=colour(name), label=name)
            truth = np.array(rows[0]["curves"][path])
            low, high = min(truth.min(), 0), max(truth.max(), 0)
            room = 0.25 * (high - low)
            axes.set(ylim=(low - room, high + room), xlim=(0, 1), title=TITLES[path])
            axes.set(xlabel="gamma", ylabel=COMPONENT.get(path, "$P_{11}$"))
        panels[0, 0].legend(fontsize=6)
    return figure
