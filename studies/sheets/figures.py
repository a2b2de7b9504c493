"""Pictures of the measured sheets. `MeasuredResults` in, figures out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

from studies.output import style
from studies.sheets.measured_record import SHEETS
from studies.sheets.measured_results import MeasuredResults
from studies.sheets.sheet_results import ModelName

COLOURS = [style.COLOURS[name] for name in ("blue", "vermilion", "green")]


def records(results: MeasuredResults) -> Figure:
    """Force, strain at rest, and profiles of strain, of the three sheets."""
    with style.figure(9.0, 6.0) as figure:
        axes = figure.subplots(2, 2)
        for name, colour in zip(SHEETS, COLOURS, strict=True):
            r = results.records[name]
            force, long = np.array(r.force), np.array(r.elongation)
            axes[0, 0].loglog(long[1:], force[1:], color=colour, linestyle="-", label=name)
            bands = r.bands_mm
            axes[0, 1].plot(bands, 100 * np.array(r.at_rest[0]), color=colour, linestyle="-")
            axes[0, 1].plot(bands, 100 * np.array(r.at_rest[1]), color=colour, linestyle=":")
            for ax, part in ((axes[1, 0], r.axial), (axes[1, 1], r.lateral)):
                last = np.array(part)[-1]
                ax.plot(bands, last / abs(last.mean()), color=colour, linestyle="-")
        long = np.array([1.0, 12.0])
        axes[0, 0].loglog(long, 2.2 * long, color="0.5", linestyle="--", label="slope 1")
        axes[0, 0].set(xlabel="elongation (mm)", ylabel="force (N)")
        axes[0, 0].legend()
        axes[0, 1].set(xlabel="y (mm)", ylabel="strain left at no load (%)", title="axial (solid), lateral (dotted)")
        axes[1, 0].set(xlabel="y (mm)", ylabel="axial strain / mean, at the end")
        axes[1, 1].set(xlabel="y (mm)", ylabel="lateral strain / mean size, at the end")
        return figure


def sections(results: MeasuredResults) -> Figure:
    """Section force over measured force along each homogeneous sheet, of the base and of the final model."""
    with style.figure(9.0, 3.6) as figure:
        axes = figure.subplots(1, 2, sharey=True)
        for ax, key in zip(axes, ("first", "second"), strict=True):
            r = results.sheets[key]
            for model, name, linestyle, colour in (
                (r.model(ModelName.BASE), ModelName.BASE, "--", COLOURS[1]),
                (r.final, ModelName.MEAN, "-", COLOURS[0]),
            ):
                values = np.array(model.sections)
                x = (np.arange(values.shape[1]) + 0.5) / values.shape[1]
                scored = values[len(values) // 2 :]
                ax.plot(x, scored.mean(axis=0), color=colour, linestyle=linestyle, label=name)
                ax.fill_between(x, scored.min(axis=0), scored.max(axis=0), color=colour, alpha=0.2, linewidth=0)
            ax.axhline(1.0, color="0.5", linewidth=0.8, linestyle="-")
            ax.set(xlabel="place along the pull, bottom to top", title=r.name)
            ax.legend(fontsize=7)
        axes[0].set(ylabel="section force / measured, later half")
        return figure


def grips(results: MeasuredResults) -> Figure:
    """Error of the force at both grips against time, before and after."""
    with style.figure(9.0, 3.4) as figure:
        axes = figure.subplots(1, 3, sharey=True)
        for ax, key in zip(axes, ("first", "second", "hetero"), strict=True):
            r = results.sheets[key]
            for model, name, linestyle in (
                (r.model(ModelName.BASE), ModelName.BASE, "--"),
                (r.final, ModelName.MEAN, "-"),
            ):
                size = np.linalg.norm(np.array(model.grip_error), axis=1)
                ax.plot(r.time, 100 * size, linestyle=linestyle, color=COLOURS[0], label=name)
            ax.set(xlabel="time (s)", title=r.name, yscale="log")
        axes[0].set(ylabel="force error (%)")
        axes[0].legend(fontsize=8)
        return figure


def stiffness(results: MeasuredResults) -> Figure:
    """Map of the stiffness of the heterogeneous sheet over that of the transferred material."""
    r = results.map
    places = np.array(r.points)
    with style.figure(5.0, 4.0) as figure:
        ax = figure.subplots()
        values = np.array(r.map)
        drawn = ax.tripcolor(places[:, 0], places[:, 1], r.triangles, values, shading="gouraud", cmap=style.SEQUENTIAL)
        figure.colorbar(drawn, label="stiffness / that of the transferred material")
        ax.set(aspect="equal", xlabel="x (mm)", ylabel="y (mm)")
        ax.grid(False)
        return figure


def homogeneous(results: MeasuredResults) -> Figure | None:
    """Error of every homogeneous test before and after."""
    lines = [(r.name, t) for r in results.loops for t in r.tests]
    if not lines:
        return None
    with style.figure(8.0, 0.28 * len(lines) + 1.0) as figure:
        ax = figure.subplots()
        y = np.arange(len(lines))[::-1]
        for when, marker, colour in (("before", "o", COLOURS[1]), ("after", "s", COLOURS[0])):
            ax.plot([100 * getattr(t, when) for _, t in lines], y, marker, color=colour, label=when, linestyle="none")
        ax.set_yticks(y, [f"{n}: {t.name}{'' if t.fitted else ' (held out)'}" for n, t in lines], fontsize=7)
        ax.set(xscale="log", xlabel="error of the stress (%)")
        ax.set_xticks([3, 5, 10, 20, 50], ["3", "5", "10", "20", "50"])
        ax.minorticks_off()
        ax.legend()
        return figure


# by name of the file; the caption of NAME is the macro figure_NAME of templates/measured.txt
FIGURES: dict[str, Callable[[MeasuredResults], Figure | None]] = {
    "records": records,
    "sections": sections,
    "grips": grips,
    "stiffness": stiffness,
    "homogeneous": homogeneous,
}
