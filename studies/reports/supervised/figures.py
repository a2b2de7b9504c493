"""Figure of a data set with every network fitted to it."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from calibrate.fitting.homogeneous.sobolev_fit import Curves
from studies.importers import homogeneous_curves
from studies.output import style
from studies.reports.supervised.supervised_fits import TRUTH, Result, curves_of, short_r2


def draw(name: str, results: list[Result]) -> Figure:
    """Stress against stretch in the three modes: data and every network fitted to them."""
    curves = curves_of(name)
    with style.figure(11, 3.6) as drawn:
        _draw(drawn, name, curves, results)
    return drawn


def _draw(drawn: Figure, name: str, curves: Curves, results: list[Result]) -> None:
    for ax, (mode, (stretch, stress)) in zip(
        drawn.subplots(1, len(curves), squeeze=False)[0], curves.items(), strict=False
    ):
        ax.plot(stretch, stress, "o", color="0.3", markersize=3.5, label="truth" if name == TRUTH else "measured")
        fine = np.linspace(min(1.0, float(stretch.min())), float(stretch.max()), 200)
        for r in results:
            layers = ", ".join(map(str, r.case.layers))
            label = f"{r.case.inputs.replace('I1I2', 'I1, I2')} ({layers}): r2 {short_r2(r.r2[mode])}"
            ax.plot(fine, r.model.homogeneous(mode, fine), linewidth=1.2, label=label)
        ax.set(
            xlabel="stretch",
            ylabel="nominal stress (MPa)",
            title=mode.replace("_", " ").replace("equib", "equi-b"),
        )
        ax.legend(fontsize=7)
    drawn.suptitle(homogeneous_curves.SOURCES.get(name, "five-term Arruda-Boyce"), fontsize=9)
