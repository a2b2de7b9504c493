"""Pictures of the study on measured data. `MeasuredResults` in, figures out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

from studies.output import style
from studies.sheets.sheet_results import BASE, FOUND, MeasuredResults
from studies.transfer.transferred import ForceAndField

COLOURS = {BASE: "orange", FOUND: "green"}


def errors(results: MeasuredResults) -> Figure:
    """Errors of force and of field of every model of every sheet: fitted hollow, held out filled; transferred models grey."""
    lines: list[tuple[str, ForceAndField, ForceAndField, str]] = []
    for name, one in results.sheets.items():
        lines += [(f"{name}: {m.name}", m.fitted, m.held_out, style.COLOURS[COLOURS[m.name]]) for m in one.models]
        rows = results.transfers[name].rows if name in results.transfers else []
        lines += [(f"{name}: transferred, {r.name}", r.fitted, r.held_out, "0.5") for r in rows if r.stiffness != 1.0]
    with style.figure(9.0, 0.26 * len(lines) + 1.0) as figure:
        axes = figure.subplots(1, 2, sharey=True)
        y = np.arange(len(lines))[::-1]
        for ax, kind in zip(axes, ("force", "field"), strict=True):
            for at, (_, fitted, held, colour) in zip(y, lines, strict=True):
                ends = [100 * getattr(part, kind) for part in (fitted, held)]
                ax.plot(ends, [at, at], color=colour, linewidth=0.8, linestyle="-")
                ax.plot(ends[:1], [at], "o", color=colour, mfc="white")
                ax.plot(ends[1:], [at], "o", color=colour)
            ax.set(xscale="log", xlabel=f"{kind} error (%)")
            ax.set_xticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
            ax.minorticks_off()
        axes[0].set_yticks(y, [line[0] for line in lines], fontsize=7)
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
