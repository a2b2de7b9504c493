"""Figures of a replay: maps of the residual, its growth with the load, forces."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from studies.output import style
from studies.replay.replayed_experiment import Replay
from studies.reports import force_record


def residual_maps(found: Replay) -> Figure:
    """Measured minus replayed displacement at the largest deformation, mm, and in standard deviations where the noise is known."""
    experiment = found.experiment
    mesh = Triangulation(*experiment.points.T, experiment.triangles)
    width, height = np.ptp(experiment.points, axis=0)
    residual = found.residual[experiment.most_deformed]
    rows = [(residual, "mm")]
    if found.noise is not None:
        rows.append((residual / found.noise, "standard deviations"))
    panel = 3.4 * min(1.5, max(0.4, height / width))
    with style.figure(7.6, len(rows) * (panel + 0.5)) as figure:
        axes = figure.subplots(len(rows), 2, squeeze=False, sharex=True, sharey=True)
        for row, (values, unit) in zip(axes, rows, strict=True):
            limit = float(np.quantile(np.abs(values[found.judged]), 0.995)) or 1.0
            for ax, component, value in zip(row, force_record.COMPONENTS, values.T, strict=True):
                image = ax.tripcolor(
                    mesh, value, shading="gouraud", cmap="RdBu_r", vmin=-limit, vmax=limit, rasterized=True
                )
                ax.set(aspect="equal", title=f"along {component}")
                ax.grid(False)
            row[0].set_ylabel("y, mm")
            bar = figure.colorbar(image, ax=row, label=f"measured - replayed,\n{unit}", shrink=0.9, extend="both")
            bar.ax.yaxis.label.set_fontsize("small")
        for ax in axes[-1]:
            ax.set_xlabel("x, mm")
    return figure


def growth(found: Replay) -> Figure:
    """Root mean square residual of every increment beside the noise."""
    experiment = found.experiment
    x, label = style.over(experiment.time, experiment.n_increments)
    with style.figure(4.8, 3.0) as figure:
        axes = figure.subplots()
        axes.plot(x, found.field_error, ".-", color=style.COLOURS["blue"], label="measured - replayed")
        if found.noise is not None:
            axes.axhline(found.noise, color="0.4", linestyle="--", label="noise of the camera")
        axes.set(xlabel=label, ylabel="root mean square, mm", ylim=(0, None))
        axes.legend()
    return figure


def forces(found: Replay) -> Figure:
    """Forces of the grips, measured and replayed, and their differences; over the whole machine record, where there is one."""
    record = found.record
    if record is None:
        return force_record.draw(found.measured, found.forces, found.experiment.time, "replayed")
    return force_record.draw(record.measured, record.replayed, record.time, "replayed", "-")
