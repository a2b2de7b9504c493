"""Figures of a prediction: curves of homogeneous tests, forces of another test."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibrate.equations.deformation_modes import MODES
from studies.output import style
from studies.reports import force_record
from studies.reports.prediction.predicted_curves import Curve
from studies.reports.prediction.predicted_forces import Forecast


def draw_curves(curves: list[Curve], unit: str, against: str | None = None) -> Figure:
    """One panel a mode: solid where calibrated, thin beyond; the known material `against` as a dotted line."""
    with style.figure(9.0, 3.8) as figure:
        panels = dict(zip(MODES, figure.subplots(1, len(MODES)), strict=True))
        for curve in curves:
            _draw_curve(panels[curve.mode], curve, against)
        figure.axes[0].set_ylabel(f"nominal stress, {unit}")
        labelled = {
            label: line
            for axes in figure.axes[::-1]
            for line, label in zip(*axes.get_legend_handles_labels(), strict=True)
        }
        figure.legend(labelled.values(), labelled.keys(), loc="outside lower center", ncols=3)
    return figure


def _draw_curve(axes: Axes, curve: Curve, against: str | None) -> None:
    colour, title = style.MODES[curve.mode]["color"], style.MODES[curve.mode]["label"]
    x, stress, inside = curve.stretch, curve.stress, curve.calibrated
    if curve.direction != "y":  # drawn already
        style.mark_range(axes, 1.0, min(curve.limit, float(x[-1])))
    else:
        colour = "0.35"
    if curve.band is not None:
        axes.fill_between(x, *curve.band, color=colour, alpha=0.25, linewidth=0, label="95 % band")
    label = None if inside.all() or curve.direction == "y" else "extrapolated"
    axes.plot(x, stress, linestyle="--", linewidth=0.9, color=colour, label=label)
    name = f"model, along {curve.direction}" if curve.direction else "model"
    axes.plot(x[inside], stress[inside], linestyle="-", linewidth=2, color=colour, label=name)
    if curve.truth is not None:
        label = None if curve.direction == "y" else against
        axes.plot(x, curve.truth, linestyle=":", color="black", label=label)
    axes.set(title=title, xlabel="stretch", xlim=(1.0, x[-1]), ylim=(0, None))


def draw_forces(found: Forecast) -> Figure:
    """Forces over time or increments, differences below; components that carry next to nothing are left out."""
    return force_record.draw(found.measured, found.forces, found.experiment.time, "predicted")
