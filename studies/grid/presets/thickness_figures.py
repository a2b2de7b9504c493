"""Figures of the thickness study that show fields: where 2D and 3D deformation differ, how fast it grows, forces.

In: `ThicknessResults`. Out: matplotlib figures; no screen is needed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.path import Path as Outline
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from meshes import Cross
from studies.accuracy.epsilon import EpsilonField
from studies.grid.axes import PLANE
from studies.grid.presets.thickness_results import ThicknessResults, arm_forces, condition_name
from studies.grid.presets.thickness_tables import SIDES
from studies.output import style

Array = NDArray[np.float64]
LOWEST = 1e-3  # lower end of the colour scale of epsilon
CLOSE_UP = 64.0  # mm
PIXELS = 640


def maps(results: ThicknessResults) -> Figure:
    """epsilon over the surface at the last increment: whole cross above, close-up below, one colour scale."""
    names = results.thicknesses
    extent = max(Cross().half_extent)
    scale = LogNorm(LOWEST, max(2 * LOWEST, max(field.epsilon[-1].max() for field in results.fields.values())))
    with style.figure(2.6 * len(names) + 1.0, 5.6) as figure:
        axes = figure.subplots(2, len(names), squeeze=False, sharex="row", sharey="row")
        places = {size: pixels(results.fields[names[0]].points, size) for size in (extent, CLOSE_UP)}
        for column, name in zip(axes.T, names, strict=True):
            field = results.fields[name]
            image = _map(column[0], field, mirrored(places[extent]), (-extent, extent), scale)
            _map(column[1], field, places[CLOSE_UP], (0.0, CLOSE_UP), scale)
            column[0].set_title(f"{name} mm thick")
            column[0].set_xticks([-0.8 * extent, 0, 0.8 * extent])
            _numbers(column[0], field, extent)
            _mark_maximum(column[1], field)
            column[1].set_xlabel("x (mm)")
        for ax in axes[:, 0]:
            ax.set_ylabel("y (mm)")
        figure.colorbar(image, ax=list(axes.ravel()), label="ε = |C2D − C3D| / |C2D| (-)", shrink=0.8, extend="min")
    return figure


def pixels(points: Array, size: float, n: int = PIXELS) -> NDArray[np.int64]:
    """Number of the nearest of `points` for each pixel (n, n), rows along y, of [0, size]^2; -1 off the specimen."""
    middles = (np.arange(n) + 0.5) * size / n
    x, y = np.meshgrid(middles, middles)
    places = np.column_stack([x.ravel(), y.ravel()])
    cross = Cross()
    inside = Outline(cross.outline()).contains_points(places)
    for hole in cross.holes():
        inside &= hole.level(places) > 1
    found = np.full(len(places), -1)
    found[inside] = cKDTree(points).query(places[inside])[1]
    return found.reshape(n, n)


def mirrored(quarter: NDArray[np.int64]) -> NDArray[np.int64]:
    """Image of the whole from that of the first quadrant."""
    half = np.hstack([quarter[:, ::-1], quarter])
    return np.vstack([half[::-1], half])


def _map(ax: Axes, field: EpsilonField, places: NDArray[np.int64], span: tuple[float, float], scale: LogNorm) -> Any:
    values = np.ma.masked_where(places < 0, field.epsilon[-1][places])
    ax.grid(False)
    ax.set_aspect("equal")
    return ax.imshow(values, origin="lower", extent=(*span, *span), norm=scale, interpolation="nearest")


def _numbers(ax: Axes, field: EpsilonField, extent: float) -> None:
    """Maximum and 95th percentile in the empty corners of the cross."""
    for x, y, text in (
        (-extent, -extent, f"max\n{field.epsilon[-1].max():.3f}"),
        (extent, -extent, f"P95\n{field.statistics().p95:.3f}"),
    ):
        ax.text(0.97 * x, 0.97 * y, text, ha="left" if x < 0 else "right", va="bottom", fontsize=8.5)


def _mark_maximum(ax: Axes, field: EpsilonField) -> None:
    x, y = field.points[field.epsilon[-1].argmax()]
    if max(x, y) <= CLOSE_UP:
        ax.plot(x, y, "o", ms=8, mfc="none", mec=style.COLOURS["vermilion"], mew=1.2)


def lines(results: ThicknessResults) -> Figure:
    """epsilon from the rims outward: over the distance in mm above, over that in thicknesses below."""
    columns = results.numbers[results.thicknesses[0]].lines
    with style.figure(2.6 * len(columns), 5.4) as figure:
        axes = figure.subplots(2, len(columns), sharey=True, squeeze=False)
        for name, numbers in results.numbers.items():
            for column, line in zip(axes.T, numbers.lines, strict=True):
                for ax, unit in zip(column, (1.0, float(name)), strict=True):
                    ax.plot(line.distance / unit, line.epsilon, label=condition_name(name), **results.look(name))
        for column, line in zip(axes.T, columns, strict=True):
            column[0].set(title=line.where, xlabel="distance from the rim (mm)", xlim=(0, None))
            column[1].set(xlabel="distance / thickness (-)", xlim=(0, 2))
        for ax in axes[:, 0]:
            ax.set_ylabel("ε (-)")
        axes[0, 0].set_ylim(0, None)
        axes[0, 0].legend(fontsize=8)
    return figure


def growth(results: ThicknessResults) -> Figure:
    """95th percentile, mean and maximum of epsilon over the displacement of the arms."""
    with style.figure(9.0, 3.2) as figure:
        axes = figure.subplots(1, 3)
        for name, field in results.fields.items():
            pull = field.time * results.settings.displacement
            increments = range(len(pull))
            curves: tuple[Any, ...] = (
                [field.statistics(increment=i).p95 for i in increments],
                [field.statistics(increment=i).mean for i in increments],
                field.epsilon.max(axis=1),
            )
            for ax, values in zip(axes, curves, strict=True):
                ax.plot(np.append(0, pull), np.append(0, values), label=condition_name(name), **results.look(name))
        for ax, title in zip(axes, ("95th percentile, by area", "mean, by area", "maximum"), strict=True):
            ax.set(title=title, xlabel="displacement of each arm (mm)", ylim=(0, None), xlim=(0, None))
        axes[0].set_ylabel("ε (-)")
        axes[0].legend(fontsize=8)
    return figure


def forces(results: ThicknessResults) -> Figure:
    """Force of an arm over thickness against displacement, 2D and 3D, and the difference."""
    plane = arm_forces(results.plane.reactions)
    with style.figure(8.4, 5.0) as figure:
        axes = figure.subplots(2, 2, sharex=True, sharey="row", height_ratios=(1.5, 1))
        pull = results.plane.time * results.settings.displacement
        for column, (side, words) in zip(axes.T, SIDES.items(), strict=True):
            top, bottom = column
            top.plot([0, *pull], [0, *plane[side]], label=condition_name(PLANE), **results.look(PLANE))
            for name, numbers in results.numbers.items():
                force = numbers.forces[side] / float(name)
                top.plot([0, *pull], [0, *force], label=condition_name(name), **results.look(name))
                bottom.plot(pull, 100 * (force / plane[side] - 1), **results.look(name))
            bottom.axhline(0, linewidth=0.8, color="black", linestyle="-")
            top.set_title(words)
            bottom.set_xlabel("displacement of each arm (mm)")
        axes[0, 0].set_ylabel("force / thickness (N/mm)")
        axes[1, 0].set_ylabel("3D − 2D (% of 2D)")
        axes[0, 0].legend(fontsize=8)
    return figure
