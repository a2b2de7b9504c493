"""Figures of the study, laid out as the paper's: states in the plane of the invariants, predictions, the matrix of r2_F, the grid of matrices.

In: `GeneraliseResults` and a truth. Out: matplotlib figures. Lines are medians over seeds; bands run from the lowest to the highest of all sizes,
seeds and likely starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.patches import Rectangle

from calibrate.equations.deformation_modes import MODES, TITLES, largest_stretch, mode_invariants
from studies.grid.generalise.calibrated_set import stretches
from studies.grid.generalise.generalise_results import GeneraliseResults, band
from studies.grid.generalise.generalise_settings import MIDDLE
from studies.output import style

ORDER = ("uniaxial", "pure_shear", "equibiaxial")
SHOWN = ("UT", "PS", "TTd", "UT+PS", "UT+TTd", "UT+cross")
INPUTS = {
    "I1": {"color": style.COLOURS["blue"], "linestyle": "-", "label": r"$I_1$"},
    "I2": {"color": style.COLOURS["vermilion"], "linestyle": "--", "label": r"$I_2$"},
    "I1I2": {"color": style.COLOURS["green"], "linestyle": "-.", "label": r"$I_1$ and $I_2$"},
}
POINTS = {"s": 2.5, "linewidths": 0, "alpha": 0.6, "rasterized": True, "zorder": 3}
TICKS = {"uniaxial": (1.5, 2, 2.5, 3, 3.5, 4), "equibiaxial": (1.2, 1.4, 1.6, 1.8, 2, 2.2, 2.4), "pure_shear": (2, 3)}
WORST_SHOWN = 0.9  # r2_F at the end of the colours


def draw_states(results: GeneraliseResults, truth: str) -> Any:
    """Every specimen in a plane of its own."""
    names = results.settings.specimens
    rows = -(-len(names) // 3)
    with style.figure(9.6, 3.1 * rows) as figure:
        grid = np.atleast_1d(figure.subplots(rows, 3, sharex=True, sharey=True))
        for axes, name in zip(grid.flat, names, strict=False):
            draw_plane(axes, results, truth, [name])
            axes.set_title(name)
        for axes in grid.flat[len(names) :]:
            axes.set_visible(False)
        for axes in np.atleast_2d(grid)[:, 0]:
            axes.set_ylabel(r"$I_2$")
        for axes in np.atleast_2d(grid)[-1]:
            axes.set_xlabel(r"$I_1$")
    return figure


def draw_plane(axes: Any, results: GeneraliseResults, truth: str, names: Sequence[str]) -> None:
    """States of tests inside the region that an incompressible sheet can reach; stretches annotated on its bounds."""
    colours = [style.COLOURS[c] for c in ("sky", "orange")]
    for name, colour in zip(names, colours, strict=False):
        points = results.states[truth][name].points
        axes.scatter(points[:, 0], points[:, 1], color=colour, label=name, **POINTS)
    end = results.settings.end_I1
    for mode in ORDER:
        values = mode_invariants(mode, np.linspace(1, largest_stretch(mode, end), 200))
        look = style.MODES[mode]
        axes.plot(
            values[:, 0], values[:, 1], color="black", linestyle=":" if mode == "pure_shear" else "-", linewidth=0.9
        )
        ticks = np.array(TICKS[mode])
        at = mode_invariants(mode, ticks)
        kept = (at <= end).all(axis=1) & (at[:, 0] > 3.3)
        axes.plot(*at[kept].T, linestyle="none", marker="o", markersize=2.6, color=look["color"])
        for stretch, (x, y) in zip(ticks[kept], at[kept], strict=True):
            offset = {"uniaxial": (2, -8), "pure_shear": (3, -7), "equibiaxial": (-12, 2)}[mode]
            axes.annotate(
                f"{stretch:g}", (x, y), xytext=offset, textcoords="offset points", fontsize=6, color=look["color"]
            )
    axes.set_xlim(2.7, end + 0.3)
    axes.set_ylim(2.7, end + 0.3)
    axes.set_aspect("equal")


def draw_predictions(results: GeneraliseResults, truth: str) -> Any:
    """States of some sets, and below them what each set of invariants predicts."""
    sets = [tests for tests in SHOWN if tests in results.settings.sets] or list(results.settings.sets[:6])
    with style.figure(2.5 * len(sets) + 0.4, 9.6) as figure:
        grid = figure.subplots(4, len(sets), squeeze=False, height_ratios=[1.25, 1, 1, 1])
        for column, tests in zip(grid.T, sets, strict=True):
            draw_plane(column[0], results, truth, tests.split("+"))
            column[0].set_title(tests.replace("+", " and "))
            column[0].set_xlabel(r"$I_1$")
            for axes, mode in zip(column[1:], ORDER, strict=True):
                draw_mode(axes, results, truth, tests, mode)
            column[-1].set_xlabel("stretch (-)")
        grid[0, 0].set_ylabel(r"$I_2$")
        for row, mode in zip(grid[1:], ORDER, strict=True):
            row[0].set_ylabel(f"{TITLES[mode]}\nnominal stress (MPa)")
            for axes in row[1:]:
                axes.tick_params(labelleft=False)
        grid[1, 0].legend(fontsize=7, loc="upper left")
    return figure


def draw_mode(axes: Any, results: GeneraliseResults, truth: str, tests: str, mode: str) -> None:
    """Predictions of the middle size, bands over all, the truth, the calibrated range."""
    stretch = stretches(mode, results.settings.end_I1)
    for inputs in results.settings.inputs:
        look = INPUTS[inputs]
        everything = [
            one for seed in results.settings.seeds for one in results.chosen(truth, seed, tests=tests, inputs=inputs)
        ]
        middle = [one for one in everything if one.layers == MIDDLE] or everything
        low, high = band(everything, mode)
        axes.fill_between(stretch, low, high, color=look["color"], alpha=0.15, linewidth=0)
        axes.plot(stretch, np.median([one.predictions[mode].stress for one in middle], axis=0), **look)
    expected = results.truth_curves.get((truth, mode))
    if expected is not None:
        axes.plot(stretch, expected, color="black", linewidth=1.0, linestyle="-", label="truth")
        axes.set_ylim(-0.05 * expected.max(), 1.8 * expected.max())
    values = mode_invariants(mode, stretch)
    inside = (values <= results.limits(truth, tests)).all(axis=1)
    style.mark_range(axes, 1.0, float(stretch[inside].max()), None)


def scores(results: GeneraliseResults, truth: str, inputs: str, layers: tuple[int, ...]) -> np.ndarray:
    """(sets, specimens): median of r2_F over seeds."""
    settings = results.settings
    return np.array([[
        np.median([results.chosen(truth, seed, tests=tests, inputs=inputs, layers=layers)[0].scores[name] for seed in settings.seeds])
        for name in settings.specimens] for tests in settings.sets])  # fmt: skip


def draw_matrix(results: GeneraliseResults, truth: str, inputs: str, layers: tuple[int, ...]) -> Any:
    """r2_F of one network: a row a set, a column a specimen; what was calibrated on has a frame."""
    settings = results.settings
    with style.figure(1.6 + 0.62 * len(settings.specimens), 1.0 + 0.36 * len(settings.sets)) as figure:
        axes = figure.subplots()
        values = scores(results, truth, inputs, layers)
        image = matrix(axes, results, values)
        for (row, column), value in np.ndenumerate(values):
            shown = f"{value:.3f}" if value > -9.995 else "<-10"
            colour = "white" if value < 0.95 else "black"
            axes.text(column, row, shown, ha="center", va="center", fontsize=7, color=colour)
        axes.set_xticks(range(len(settings.specimens)), settings.specimens)
        axes.set_yticks(range(len(settings.sets)), [tests.replace("+", " & ") for tests in settings.sets])
        axes.set_xlabel("reaction force predicted")
        axes.set_ylabel("calibrated on")
        figure.colorbar(image, ax=axes, label=r"$r^2_F$", extend="min")
    return figure


def matrix(axes: Any, results: GeneraliseResults, values: np.ndarray) -> Any:
    """The image of (sets, specimens), with frames."""
    settings = results.settings
    image = axes.imshow(values, vmin=WORST_SHOWN, vmax=1, cmap=style.SEQUENTIAL, aspect="auto")
    for row, tests in enumerate(settings.sets):
        for name in tests.split("+"):
            corner = settings.specimens.index(name) - 0.5, row - 0.5
            axes.add_patch(Rectangle(corner, 1, 1, fill=False, edgecolor=style.COLOURS["vermilion"], linewidth=1.2))
    axes.grid(visible=False)
    return image


def draw_grid(results: GeneraliseResults, truth: str) -> Any:
    """The matrices of every set of invariants and every size."""
    settings = results.settings
    with style.figure(2.1 * len(settings.sizes) + 0.8, 2.5 * len(settings.inputs)) as figure:
        grid = figure.subplots(len(settings.inputs), len(settings.sizes), squeeze=False, sharex=True, sharey=True)
        for row, inputs in zip(grid, settings.inputs, strict=True):
            for axes, layers in zip(row, settings.sizes, strict=True):
                image = matrix(axes, results, scores(results, truth, inputs, layers))
                axes.set_xticks(range(len(settings.specimens)), settings.specimens, rotation=90, fontsize=6)
                axes.set_yticks(range(len(settings.sets)), [t.replace("+", " & ") for t in settings.sets], fontsize=6)
            row[0].set_ylabel(INPUTS[inputs]["label"])
        for axes, layers in zip(grid[0], settings.sizes, strict=True):
            axes.set_title(f"({', '.join(map(str, layers))})")
        figure.colorbar(image, ax=grid, label=r"$r^2_F$", extend="min", shrink=0.6)
    return figure


def draw_ambiguity(results: GeneraliseResults, truth: str) -> Any:
    """Ambiguity over sizes and starts against the coverage of a set, by mode and set of invariants."""
    settings = results.settings
    with style.figure(9.6, 3.4) as figure:
        for axes, mode in zip(figure.subplots(1, len(MODES), sharey=True), ORDER, strict=True):
            for inputs, marker in zip(settings.inputs, "osD", strict=False):
                x, y = [], []
                for tests in settings.sets:
                    x.append(100 * results.coverage(truth, tests))
                    y.append(100 * results.spread(results.set_ambiguity, truth, tests, inputs, mode).median)
                look = INPUTS[inputs]
                axes.plot(
                    x,
                    np.maximum(y, 0.01),
                    marker=marker,
                    markersize=4,
                    linestyle="none",
                    color=look["color"],
                    label=look["label"],
                )
                if inputs == settings.inputs[-1]:
                    for tests, a, b in zip(settings.sets, x, y, strict=True):
                        axes.annotate(
                            tests.replace("+", " & "),
                            (a, max(b, 0.01)),
                            xytext=(3, 2),
                            textcoords="offset points",
                            fontsize=5.5,
                        )
            axes.set_yscale("log")
            axes.set_title(TITLES[mode])
            axes.set_xlabel("states covered (%)")
        figure.axes[0].set_ylabel("ambiguity over sizes and starts (%)")
        figure.axes[0].legend(fontsize=7)
    return figure
