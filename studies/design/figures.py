"""Figures of a design: outlines and states, predicted deviations, bands of the stress, and the course of a search."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from calibrate.equations.deformation_modes import MODES, TITLES, mode_invariants
from meshes import Specimen
from meshes.drawing import CUT, GRIP, read_curves
from studies.design.candidates import Place, Ranking
from studies.design.pattern_search import Evaluation
from studies.design.validation import Validation
from studies.output import style, write_figure

Array = NDArray[np.float64]
COLUMNS = 4
FAR = 20.0  # stretch at which the bounding curves end


def draw_outline(axes: Axes, specimen: Specimen) -> None:
    """Outline and holes, gripped sides thick; mm."""
    axes.add_patch(Polygon(specimen.outline(), facecolor="0.9", edgecolor="black", linewidth=0.8))
    for hole in specimen.holes():
        axes.add_patch(Polygon(hole.rim(), facecolor="white", edgecolor="black", linewidth=0.8))
    x, y = specimen.half_extent
    corners = np.array([(c.x, c.y) for c in specimen.corners()])
    for side, (axis, value) in {"left": (0, -x), "right": (0, x), "bottom": (1, -y), "top": (1, y)}.items():
        if side in specimen.loaded:
            on = corners[np.isclose(corners[:, axis], value)]
            axes.plot(
                *on[[on[:, 1 - axis].argmin(), on[:, 1 - axis].argmax()]].T,
                color=style.COLOURS["vermilion"],
                linestyle="-",
                lw=3,
            )
    axes.set(aspect="equal", xlim=(-1.1 * x, 1.1 * x), ylim=(-1.1 * y, 1.1 * y))
    axes.grid(False)
    axes.tick_params(labelsize=6)


def draw_states(axes: Axes, states: Array, tops: tuple[float, float]) -> None:
    """I1 - 3 and I2 - 3 that are reached, between the curves of uniaxial and equi-biaxial tension."""
    axes.plot(*np.maximum(states - 3, 1e-4).T, ".", markersize=1.5, color=style.COLOURS["sky"], rasterized=True)
    for mode in MODES:
        curve = mode_invariants(mode, np.geomspace(1.005, FAR, 400)) - 3
        axes.plot(*curve.T, **{**style.MODES[mode], "linewidth": 0.9})
    axes.set(xscale="log", yscale="log", xlim=(1e-2, 1.5 * tops[0]), ylim=(1e-2, 1.5 * tops[1]))
    axes.tick_params(labelsize=6)


def candidates_figure(path: Path, ranking: Ranking) -> None:
    """Every ranked candidate: its outline, mm, and below it the states that it reaches at its limit."""
    rows = -(-len(ranking.places) // COLUMNS)
    with style.figure(8.6, 3.5 * rows) as figure:
        cells = figure.subfigures(rows, COLUMNS, squeeze=False).ravel()
        for number, (cell, place) in enumerate(zip(cells, ranking.places, strict=False), start=1):
            above, below = cell.subplots(2, 1)
            cell.suptitle(f"{number}. {place.candidate.title}", fontsize=9)
            draw_outline(above, place.candidate.specimen)
            assert place.candidate.states is not None
            draw_states(below, place.candidate.states, ranking.family.tops)
            below.set_xlabel("$I_1 - 3$", fontsize=7)
            below.set_ylabel("$I_2 - 3$", fontsize=7)
            if number == 1:
                below.legend(fontsize=5.5, loc="upper left")
        write_figure(path, figure)


def deviations_figure(path: Path, ranking: Ranking) -> None:
    """Predicted standard deviation of the stress in each mode, over its root mean square: by the test (full), by the equations (open)."""
    with style.figure(6.8, 1.2 + 0.32 * len(ranking.places)) as figure:
        axes = figure.subplots()
        for mode in ranking.family.stretches:
            look = {"color": style.MODES[mode]["color"], "linestyle": "none", "marker": MARKERS[mode]}
            for kind, face in (("test", look["color"]), ("equations", "none")):
                found = [getattr(place, kind) for place in ranking.places]
                values = [np.nan if c is None else 100 * c.deviation[mode] for c in found]
                label = f"{TITLES[mode]}, {'the test' if kind == 'test' else 'equations of a calibration'}"
                axes.plot(values, range(len(values)), **look, markerfacecolor=face, label=label)
        axes.set(
            xscale="log", xlabel="predicted standard deviation of the stress, %", ylim=(len(ranking.places) - 0.5, -0.5)
        )
        axes.set_yticks(
            range(len(ranking.places)), [f"{i}. {p.candidate.title}" for i, p in enumerate(ranking.places, 1)]
        )
        axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1, 1))
        write_figure(path, figure)


MARKERS = {"uniaxial": "o", "equibiaxial": "s", "pure_shear": "D"}
CURVES = ("blue", "green", "orange", "vermilion")
LINES = ("-", "-.", "--", ":")


def curves_figure(path: Path, ranking: Ranking, shown: Sequence[Place]) -> None:
    """Predicted standard deviation of the nominal stress over the stress, along each mode: before any test and after those of `shown`, four
    at most."""
    family = ranking.family
    with style.figure(8.6, 3.4) as figure:
        for axes, mode in zip(figure.subplots(1, len(family.stretches), sharey=True), family.stretches, strict=True):
            x, c = family.stretch(mode), family.stress_sensitivity(mode)
            percent = 100 / family.stress(mode)
            before = ranking.known.deviation(c) * percent
            axes.plot(x, before, color="0.5", linestyle=(0, (1, 2)), label="before")
            for place, colour, line in zip(shown, CURVES, LINES, strict=False):
                assert place.candidate.test is not None
                values = (ranking.known + place.candidate.test).deviation(c) * percent
                axes.plot(x, values, color=style.COLOURS[colour], linestyle=line, label=place.candidate.title)
            axes.set(yscale="log", xlabel="stretch", title=TITLES[mode])
        figure.axes[0].set_ylabel("standard deviation of the stress, %")
        figure.legend(
            *figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(shown) + 1, fontsize=7
        )
        write_figure(path, figure)


def validation_figure(path: Path, ranking: Ranking, validation: Validation) -> None:
    """Predicted and actual error of every candidate, %: median over seeds, and their range."""
    with style.figure(6.4, 4.2) as figure:
        axes = figure.subplots()
        for number, place in enumerate(ranking.places, start=1):
            title = place.candidate.title
            actual, x = 100 * validation.of(title), 100 * place.test.overall
            if not np.isfinite(actual).all():
                continue
            middle = np.median(actual)
            reach = [[middle - actual.min()], [actual.max() - middle]]
            axes.errorbar(x, middle, reach, fmt="o", color=style.COLOURS["blue"], markersize=4, linestyle="none")
            axes.annotate(str(number), (x, middle), xytext=(4, 3), textcoords="offset points", fontsize=8)
            axes.plot([], [], linestyle="none", label=f"{number}  {title}")
        axes.axline((1, 1), slope=1, color="0.6", linestyle=":", label="equal")
        axes.set(
            xscale="log",
            yscale="log",
            xlabel="predicted deviation of the stress, %",
            ylabel="actual error of the stress, %",
        )
        axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1, 1), handlelength=1)
        write_figure(path, figure)


def drawing_figure(path: Path, drawing: Path) -> None:
    """A drawing as another program reads it: cuts black, lines at which the grips begin vermilion; mm."""
    curves = read_curves(drawing)
    with style.figure(6.4, 4.2) as figure:
        axes = figure.subplots()
        for layer, colour, line in ((CUT, "black", "-"), (GRIP, style.COLOURS["vermilion"], "--")):
            for points in curves.get(layer, []):
                axes.plot(*points.T, color=colour, linestyle=line, linewidth=0.9)
        axes.set(aspect="equal", xlabel="mm", ylabel="mm")
        write_figure(path, figure)


def search_figure(
    path: Path, evaluations: Sequence[Evaluation], specimen: Specimen, states: Array, tops: tuple[float, float]
) -> None:
    """Scores of the search in their order, the specimen that it found, and the states that this reaches."""
    with style.figure(8.6, 3.0) as figure:
        course, outline, plane = figure.subplots(1, 3)
        scores = np.array([100 * e.score for e in evaluations])
        kept = np.isfinite(scores)
        course.plot(np.flatnonzero(kept) + 1, scores[kept], "o", markersize=3, label="within the limits")
        course.plot(np.arange(len(scores)) + 1, np.minimum.accumulate(scores), linestyle="-", label="best so far")
        course.set(yscale="log", xlabel="evaluation", ylabel="predicted deviation of the stress, %")
        course.legend(fontsize=7)
        draw_outline(outline, specimen)
        outline.set(xlabel="mm")
        draw_states(plane, states, tops)
        plane.set(xlabel="$I_1 - 3$", ylabel="$I_2 - 3$")
        write_figure(path, figure)
