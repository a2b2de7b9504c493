"""Figures of a discovery: a `View` in, matplotlib figures out. No screen is needed; all can be read in grey print."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from calibrate.diagnosis.problem import Part
from calibrate.diagnosis.score_tests import Score
from calibrate.diagnosis.selection.rounds import Round
from calibrate.diagnosis.selection.thresholds import Thresholds
from calibrate.effects import Effect
from calibrate.models.addition_json import amplitude_unit
from calibrate.models.parameter_covariance import Z95
from studies.output import style
from studies.reports.discovery.candidate_outcome import WORDS, untested_words
from studies.reports.discovery.replays.replay_section import BASE, FINAL, NEO_HOOKE
from studies.reports.discovery.replays.replayed_forces import force_courses
from studies.reports.discovery.replays.replayed_models import FEW
from studies.reports.discovery.view import View, held_increments, stiffness_of_triangles
from studies.reports.force_record import COMPONENTS, worth_drawing

Array = NDArray[np.float64]
HELD_OUT = "0.9"
LEVELS = (0, 1, 1.5, 2, 3, 5, 10, 20, 50, 100)
LOOKS = {
    BASE: {"color": style.COLOURS["vermilion"], "linestyle": "--", "marker": "x", "ms": 4},
    FINAL: {"color": style.COLOURS["blue"], "linestyle": "-", "marker": ".", "ms": 5},
    NEO_HOOKE: {"color": "0.5", "linestyle": ":", "marker": "+", "ms": 5},
    FEW: {"color": style.COLOURS["purple"], "linestyle": "--", "marker": "D", "ms": 3},
}
COMPETING = {"color": style.COLOURS["purple"], "linestyle": ":"}  # few effects that compete with the most probable


def residual_map(view: View, part: Part) -> Figure:
    """Decorrelated residuals at a middle and the last increment and over all, base model above the final one."""
    t = part.experiment.n_increments
    chosen = sorted({(t - 1) // 2, t - 1})
    maps = view.maps[view.discovery.problem.parts.index(part)]
    width, height = np.ptp(part.experiment.points, axis=0)
    panel = 2.6 * min(1.5, max(0.4, height / width))
    held = held_increments(part)
    titles = [f"increment {i + 1}{' (held out)' if held[i] else ''}" for i in chosen] + ["root mean square of all"]
    titles = titles if t > 1 else titles[:1]
    points = part.experiment.points
    mesh = Triangulation(points[:, 0], points[:, 1], part.experiment.triangles)
    norm = BoundaryNorm(LEVELS, 256, extend="max")
    with style.figure(2.6 * len(titles) + 1.1, len(maps) * (panel + 0.3) + 0.4) as figure:
        axes = figure.subplots(len(maps), len(titles), squeeze=False, sharex=True, sharey=True)
        for row, (name, values) in zip(axes, maps.items(), strict=True):
            panels = [*values[chosen], np.sqrt((values**2).mean(axis=0))][: len(titles)]
            for ax, title, value in zip(row, titles, panels, strict=True):
                image = ax.tripcolor(mesh, value, shading="gouraud", cmap="magma_r", norm=norm, rasterized=True)
                ax.set(aspect="equal", title=title)
                ax.grid(False)
                ax.tick_params(labelsize=7)
            row[0].set_ylabel(f"{name}\ny, mm")
        for ax in axes[-1]:
            ax.set_xlabel("x, mm")
        figure.colorbar(image, ax=axes, label="imbalance, standard deviations", ticks=LEVELS, format="%g", shrink=0.9)
        return figure


def stiffness(view: View, part: Part) -> Figure | None:
    """Stiffness of the final model over the sheet, over that of its material; None where it is the same everywhere."""
    values = stiffness_of_triangles(part, view.discovery.final)
    if values is None:
        return None
    (width, height), limit = np.ptp(part.experiment.points, axis=0), max(np.abs(values - 1).max(), 1e-6)
    with style.figure(5.0, 4.2 * min(1.5, max(0.4, height / width)) + 0.4) as figure:
        ax = figure.subplots()
        image = ax.tripcolor(
            *part.experiment.points.T, part.experiment.triangles, facecolors=values, cmap=style.DIVERGING, vmin=1 - limit,
            vmax=1 + limit, rasterized=True,
        )  # fmt: skip
        figure.colorbar(image, ax=ax, label="stiffness over that of the material")
        ax.set(aspect="equal", xlabel="x, mm", ylabel="y, mm")
        ax.grid(False)
        return figure


def force_history(view: View, part: Part) -> Figure:
    """Forces read and predicted over time or increments, errors below; increments held out are shaded."""
    found = {name: view.forces(part, fit) for name, fit in view.models.items()}
    panels = worth_drawing({name: v[0] for name, v in found["base model"].items()})
    x, label = style.over(part.experiment.time, part.experiment.n_increments)
    with style.figure(max(4.8, 3.0 * len(panels)), 4.8) as figure:
        axes = figure.subplots(2, len(panels), squeeze=False, sharex=True, height_ratios=(2, 1.4))
        for (top, bottom), (boundary, k) in zip(axes.T, panels, strict=True):
            top.set_title(f"{boundary} edge, {COMPONENTS[k]}")
            measured, _, spread = (v[:, k] for v in found["base model"][boundary])
            top.plot(x, measured, "o", color="black", mfc="none", ms=6, label="measured")
            bottom.fill_between(x, -Z95 * spread, Z95 * spread, color="0.75", lw=0, label="95 % of noise")
            for name, by_boundary in found.items():
                predicted = by_boundary[boundary][1][:, k]
                top.plot(x, predicted, lw=1.1, label=name, **LOOKS[name])
                bottom.plot(x, predicted - measured, lw=0.9, **LOOKS[name])
            bottom.axhline(0, color="0.4", lw=0.6)
            for ax in (top, bottom):
                _shade(ax, x, held_increments(part))
            bottom.set_xlabel(label)
        axes[0, 0].set_ylabel("force on the specimen, N")
        axes[1, 0].set_ylabel("predicted - measured, N")
        axes[0, 0].legend(fontsize=8)
        axes[1, 0].legend(fontsize=7)
        return figure


def _shade(ax: Axes, x: Array, held: NDArray[np.bool_]) -> None:
    """Mark the increments held out: half way to their neighbours."""
    middle = 0.5 * (x[1:] + x[:-1])
    first, last = (2 * x[0] - middle[0], 2 * x[-1] - middle[-1]) if x.size > 1 else (x[0] - 0.5, x[0] + 0.5)
    edges = np.concatenate([[first], middle, [last]])
    for i in np.flatnonzero(held):
        ax.axvspan(edges[i], edges[i + 1], color=HELD_OUT, lw=0, zorder=0)


def scores(view: View) -> Figure:
    """Scores of all candidates in the first and the last round; filled where significant. Who has none in one of them: why."""
    rounds, effects = view.discovery.rounds, {effect.name: effect for effect in view.effects}
    shown = {"base model": rounds[0]} if len(rounds) == 1 else {"base model": rounds[0], "final model": rounds[-1]}
    largest = max([10.0, *(r.score.score for now in shown.values() for r in now.candidates if r.score.is_tested)])
    tested = dict.fromkeys(row.name for now in shown.values() for row in now.candidates if row.score.is_tested)
    names = list(tested)[::-1]
    with style.figure(4.6 * len(shown) + 0.4, 0.27 * max(len(names), 3) + 1.0) as figure:
        axes = figure.subplots(1, len(shown), sharey=True, sharex=True, squeeze=False)[0]
        for ax, (name, now) in zip(axes, shown.items(), strict=True):
            _bars(ax, now, [effects[one] for one in names], view.discovery.thresholds)
            ax.set(title=f"residual of the {name}", xlabel="score (fall of the whitened misfit)", xlim=(0, 8 * largest))
        axes[0].set_yticks(range(len(names)), names, fontsize=8)
        return figure


def _bars(ax: Axes, now: Round, effects: list[Effect], thresholds: Thresholds) -> None:
    by_name = {row.name: row.score for row in now.candidates}
    for place, effect in enumerate(effects):
        score = by_name.get(effect.name)
        if score is None or not score.is_tested:
            words = _without_score(now, effect, score)
            ax.text(0.02, place, words, va="center", fontsize=7, transform=ax.get_yaxis_transform())
            continue
        significant = score.adjusted < thresholds.significance
        ax.barh(
            place, score.score, height=0.7, edgecolor=style.COLOURS["blue"], linewidth=0.8,
            facecolor=style.COLOURS["blue"] if significant and score.admissible else "white",
            hatch="////" if significant and not score.admissible else None,
        )  # fmt: skip
        text = f"p {WORDS.p(value=score.adjusted)}"
        ax.annotate(text, (max(score.score, 0.0), place), (3, 0), textcoords="offset points", va="center", fontsize=7)
    ax.set_xscale("symlog", linthresh=10.0)
    ax.grid(False, axis="y")


def _without_score(now: Round, effect: Effect, score: Score | None) -> str:
    """Why an effect has no score in a round."""
    if effect.name in now.fit.names:
        return "in the model"
    if score is not None:
        return untested_words(score)
    return "not tested" if effect.beside is None else f"a candidate only beside {effect.beside.name}"


def intervals(view: View) -> Figure | None:
    """Amplitudes of the effects in the final model with 95 % intervals, at its level; None where nothing was added."""
    final = view.discovery.final
    if not final.additions:
        return None
    sizes = [len(a.amplitudes) for a in final.additions]
    tested = {now.added: row.score for now in view.discovery.rounds for row in now.candidates if row.name == now.added}
    with style.figure(6.0, 0.3 * sum(sizes) + 0.95 * len(sizes)) as figure:
        axes = figure.subplots(len(sizes), 1, squeeze=False, height_ratios=[n + 1 for n in sizes])[:, 0]
        for ax, addition, deviations in zip(axes, final.additions, final.deviations, strict=True):
            score, factors = tested.get(addition.effect.name), np.array(addition.stiffness_factors(view.level))
            pairs = [(addition.amplitudes, deviations), *([] if score is None else [(score.amplitudes, score.errors)])]
            _intervals(
                ax, addition.effect, [(factors * values, factors * errors) for values, errors in pairs], view.unit
            )
        axes[0].legend(fontsize=7)
        return figure


def _intervals(ax: Axes, effect: Effect, found: list[tuple[Array, Array]], unit: str) -> None:
    """found: amplitudes (p,) with their deviations (p,), as fitted and, where they were, as the score test had them."""
    parameters = effect.amplitudes
    places = np.arange(len(parameters))[::-1].astype(float)
    styles: list[dict[str, Any]] = [
        {"fmt": "o", "ms": 5, "color": style.COLOURS["blue"], "label": "fitted, 95 %"},
        {"fmt": "s", "ms": 4, "mfc": "white", "color": style.COLOURS["vermilion"], "label": "score test, 95 %"},
    ]
    for k, ((values, deviations), drawn) in enumerate(zip(found, styles, strict=False)):
        ax.errorbar(values, places - 0.25 * k, xerr=Z95 * deviations, capsize=3, linestyle="none", **drawn)
    ax.axvline(0, color="0.4", lw=0.8, ls="--")
    low, high = ax.get_xlim()
    if low < parameters[0].lower:
        ax.axvspan(low, parameters[0].lower, color="0.88", lw=0, label="not admissible")
    ax.set_xlim(low, high)
    ax.set_yticks(places, [p.name for p in parameters])
    ax.set_ylim(-0.8, len(places) - 0.4)
    ax.set_title(effect.name)
    label = amplitude_unit(parameters[0], unit)
    ax.set_xlabel("amplitude" + ("" if label == "1" else f", {label}"), fontsize=8)


def replayed_forces(view: View) -> Figure | None:
    """Force of every test over time or increments, measured and replayed by each model, and the differences over the largest; held-out
    increments shaded. None where no force was replayed."""
    courses = force_courses(view.discovery)
    if not courses:
        return None
    tests = sorted({one.test for one in courses})
    with style.figure(max(4.8, 3.4 * len(tests)), 4.8) as figure:
        axes = figure.subplots(2, len(tests), squeeze=False, sharex="col", height_ratios=(2, 1.4))
        for (top, bottom), test in zip(axes.T, tests, strict=True):
            part, own = view.discovery.problem.parts[test], [one for one in courses if one.test == test]
            times, label = style.over(part.experiment.time, part.experiment.n_increments)
            pictures = part.experiment.pictures
            x = times[pictures][own[0].pictures]
            top.plot(x, own[0].measured, "o", color="black", mfc="none", ms=6, label="measured")
            for one in own:
                look = LOOKS.get(one.model, COMPETING)
                top.plot(x, one.replayed, lw=1.1, label=one.model, **look)
                bottom.plot(x, 100 * one.difference, lw=0.9, **look)
            bottom.axhline(0, color="0.4", lw=0.6)
            for ax in (top, bottom):
                _shade(ax, times[pictures], held_increments(part)[pictures])
            top.set_title(part.experiment.name)
            bottom.set_xlabel(label)
        axes[0, 0].set_ylabel("force, N")
        axes[1, 0].set_ylabel("difference, % of the largest")
        axes[0, 0].legend(fontsize=7)
        return figure


OF_A_TEST: dict[str, Callable[[View, Part], Figure | None]] = {
    "residual_map": residual_map, "stiffness": stiffness, "forces": force_history
}  # fmt: skip
OF_ALL: dict[str, Callable[[View], Figure | None]] = {
    "replayed_forces": replayed_forces,
    "scores": scores,
    "amplitudes": intervals,
}


def caption(name: str, **values: str) -> str:
    """The caption of a figure; of one test with its name."""
    return str(getattr(WORDS, f"{name}_caption")(**values))
