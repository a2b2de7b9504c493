"""Pictures of the study on measured data. `MeasuredResults` in, figures out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

from studies.output import style
from studies.sheets.sheet_results import ALL, BASE, FOUND, NEO_HOOKE, MeasuredResults
from studies.transfer.transferred import AS_IT_IS

MODELS = {NEO_HOOKE: ("o", "vermilion"), BASE: ("D", "orange"), FOUND: ("^", "green"), ALL: ("s", "blue")}


def errors(results: MeasuredResults) -> Figure:
    """Errors of every model on increments that were held out: of the force against of the field, a panel a sheet."""
    with style.figure(9.0, 3.4) as figure:
        axes = np.ravel(figure.subplots(1, len(results.sheets), sharex=True, sharey=True, squeeze=False))
        for ax, (name, one) in zip(axes, results.sheets.items(), strict=True):
            for model in one.models:
                marker, colour = MODELS[model.name]
                x, y = 100 * model.held_out.field, 100 * model.held_out.force
                ax.plot(x, y, marker, color=style.COLOURS[colour], label=model.name, linestyle="none")
            for row in results.transfers[name].rows if name in results.transfers else ():
                if row.name != AS_IT_IS:
                    ax.plot(100 * row.held_out.field, 100 * row.held_out.force, ".", color="0.6")
                    ax.annotate(row.name, (100 * row.held_out.field, 100 * row.held_out.force), fontsize=5, color="0.4")
            ax.set(title=name, xlabel="field error (%)", xlim=(0, None), ylim=(0, None))
        axes[0].set(ylabel="force error (%)")
        axes[0].legend(fontsize=7)
        return figure


def homogeneous(results: MeasuredResults) -> Figure | None:
    """Error of every homogeneous test before and after."""
    lines = [(r.name, t) for r in results.loops for t in r.tests]
    if not lines:
        return None
    with style.figure(8.0, 0.28 * len(lines) + 1.0) as figure:
        ax = figure.subplots()
        y = np.arange(len(lines))[::-1]
        for when, marker, colour in (("before", "o", "vermilion"), ("after", "s", "blue")):
            values = [100 * getattr(t, when) for _, t in lines]
            ax.plot(values, y, marker, color=style.COLOURS[colour], label=when, linestyle="none")
        ax.set_yticks(y, [f"{n}: {t.name}{'' if t.fitted else ' (held out)'}" for n, t in lines], fontsize=7)
        ax.set(xscale="log", xlabel="error of the stress (%)")
        ax.set_xticks([3, 5, 10, 20, 50], ["3", "5", "10", "20", "50"])
        ax.minorticks_off()
        ax.legend()
        return figure


# by name of the file; the caption of NAME is the macro figure_NAME of templates/measured.txt
FIGURES: dict[str, Callable[[MeasuredResults], Figure | None]] = {"errors": errors, "homogeneous": homogeneous}
