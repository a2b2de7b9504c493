"""The resolution study: how coarse may a camera be? One cross in plane stress, several resolutions, the losses side by side.

In: `Results`. Out: the page of its report: ``resolution.csv``, the paper's figure for each loss, claims. Medians and ranges
are over noise seeds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from calibrate.equations.deformation_modes import MODES, TITLES
from meshes import Mesh
from studies.grid.axes import Loss, Settings
from studies.grid.case import EXTRAPOLATION, Curve, Fit
from studies.grid.claims import NOISES, Claim, ClaimVerdict, Statement
from studies.grid.report import COMMON, Page, Picture, Section, Table, Text, claims_section
from studies.grid.results import Results, Spread, read
from studies.grid.study import Preset
from studies.output import style
from studies.output.words import Words

WORDS = Words("resolution")
COLUMNS = ("loss", "nodes kept (%)", "nodes", "noise", "mode", "range", "fits", "bias median (%)", "bias min (%)",
           "bias max (%)", "r2 median", "r2 min", "largest error median (%)")  # fmt: skip
TARGET_COLUMNS = ("noise", "nodes kept (%)", "worst |median bias| (%)", "lowest median r2", "limits", "met")
FIT_COLUMNS = ("nodes kept (%)", "seed", "reduced chi-square", "optimiser", "seconds")


@dataclass(frozen=True)
class Limits:
    """Of bias, %, and r2, inside the calibrated range; modes: by which factor the modes differ."""

    clean_bias: float = 0.3
    clean_r2: float = 0.999
    noisy_bias: float = 1.0
    noisy_r2: float = 0.99
    modes: float = 1.1

    def of(self, noisy: bool) -> tuple[float, float]:
        """(bias, r2)."""
        return (self.noisy_bias, self.noisy_r2) if noisy else (self.clean_bias, self.clean_r2)


LIMITS = Limits()


@dataclass(frozen=True)
class Row:
    """Agreement over seeds: bias and the largest error in %; place: 'inside' or 'outside' the calibrated range."""

    loss: Loss
    resolution: str
    nodes: int
    noisy: bool
    mode: str
    place: str
    bias: Spread
    r2: Spread
    largest: Spread

    def cells(self) -> list[Any]:
        """See `COLUMNS`."""
        return [self.loss, float(self.resolution), self.nodes, NOISES[self.noisy], self.mode, self.place, self.bias.count,
                self.bias.median, self.bias.low, self.bias.high, self.r2.median, self.r2.low, self.largest.median]  # fmt: skip


def rows_of(results: Results) -> list[Row]:
    """One a loss, resolution, noise, range and mode."""
    nodes = {result.case.resolution: result.nodes for result in results.cases}
    rows = []
    for loss in results.losses:
        for resolution in results.settings.resolutions:
            for noisy in NOISES:
                fits = [*results.fits(loss, noisy, resolution=resolution).values()]
                if fits:
                    rows += [_row(fits, place, mode, (loss, resolution, nodes[resolution], noisy))
                             for place in ("inside", "outside") for mode in MODES]  # fmt: skip
    return rows


def _row(fits: list[Fit], place: str, mode: str, keys: tuple[Loss, str, int, bool]) -> Row:
    scores = [getattr(fit, place)[[*MODES].index(mode)] for fit in fits]
    bias, r2 = Spread.of(100 * s.bias for s in scores), Spread.of(s.r2 for s in scores)
    return Row(*keys, mode, place, bias, r2, Spread.of(100 * s.max_error for s in scores))


def targets(rows: list[Row]) -> list[list[Any]]:
    """Rows of `TARGET_COLUMNS` for the default loss: clean data at 100 %, noisy data at 100 % and 50 %."""
    found = []
    for noisy, resolution in ((False, "100"), (True, "100"), (True, "50")):
        chosen = [r for r in rows if r.loss is Loss.WEIGHTED and r.resolution == resolution and r.noisy is noisy
                  and r.place == "inside"]  # fmt: skip
        if chosen:
            bias, r2 = max(abs(r.bias.median) for r in chosen), min(r.r2.median for r in chosen)
            most, least = LIMITS.of(noisy)
            met = bias <= most and r2 >= least
            found.append([NOISES[noisy], float(resolution), bias, r2, f"{most} %, {least}", met])
    return found


def claims(results: Results, rows: list[Row]) -> list[Claim]:
    """What the study says of the paper's two claims, by loss."""
    noisy = [row for row in rows if row.noisy]
    found = [_inside(loss, [r for r in noisy if r.loss is loss and r.place == "inside"]) for loss in results.losses]
    return [*found, _outside([r for r in noisy if r.loss is Loss.WEIGHTED and r.place == "outside"])]


def _inside(loss: Loss, rows: list[Row]) -> Claim:
    if not rows:
        return Claim(
            Statement.RELIABLE_INSIDE, ClaimVerdict.NOT_STUDIED, limits=_inside_limits(), loss=loss, noisy=True
        )
    bias, least = LIMITS.of(noisy=True)
    missed = {r.resolution for r in rows if abs(r.bias.median) > bias or r.r2.median < least}
    worst = max((r.bias.median for r in rows), key=abs)
    found = {"bias": worst, "r2": min(r.r2.median for r in rows), "missed": len(missed)}
    verdict = ClaimVerdict.of(not missed)
    return Claim(Statement.RELIABLE_INSIDE, verdict, found, _inside_limits(), loss, noisy=True)


def _inside_limits() -> dict[str, float]:
    return {"bias": LIMITS.noisy_bias, "r2": LIMITS.noisy_r2}


def _outside(rows: list[Row]) -> Claim:
    """Where the modes do not differ the claim stays open: with I1 alone they share one function of I1."""
    limits = {"extrapolation": EXTRAPOLATION, "ratio": LIMITS.modes}
    found = {mode: max((r.bias.high - r.bias.low for r in rows if r.mode == mode), default=np.nan) for mode in MODES}
    if not all(np.isfinite(v) for v in found.values()):
        verdict, found = ClaimVerdict.NOT_STUDIED, {}
    elif max(found.values()) < LIMITS.modes * min(found.values()):
        verdict = ClaimVerdict.OPEN
    else:
        verdict = ClaimVerdict.of(max(found, key=lambda mode: found[mode]) == "uniaxial")
    shown = {TITLES[mode]: value for mode, value in found.items()}
    return Claim(Statement.UNIAXIAL_WORST_OUTSIDE, verdict, shown, limits, Loss.WEIGHTED, noisy=True)


def draw(results: Results, loss: Loss) -> Any:
    """Layout of the paper's figure: meshes above; uniaxial, equi-biaxial, pure shear below, clean and noisy."""
    levels = results.settings.resolutions
    with style.figure(10.0, 10.5) as figure:
        parts: Any = figure.subfigures(2, 1, height_ratios=[1, 2.4])
        top, bottom = parts
        for axes, level in zip(np.atleast_1d(top.subplots(1, len(levels))), levels, strict=True):
            draw_mesh(axes, read(results.folder / "meshes" / f"cross_{level}.npz", Mesh.load), level)
        grid = bottom.subplots(2, 3, sharey="col", sharex="col")
        for row, noisy in zip(grid, NOISES, strict=True):
            for axes, mode in zip(row, MODES, strict=True):
                draw_mode(axes, results, loss, mode, noisy)
            row[0].set_ylabel("nominal stress (MPa)")
        for axes in grid[1]:
            axes.set_xlabel("stretch (-)")
        grid[0, 0].legend(fontsize=7.5, loc="upper left")
        figure.suptitle(WORDS.title(loss=COMMON.loss(name=loss), settings=results.settings), fontsize=8)
    return figure


def draw_mesh(axes: Any, mesh: Mesh, level: str) -> None:
    """A triangulation, and its numbers as title."""
    axes.triplot(mesh.points[:, 0], mesh.points[:, 1], mesh.cells, color="0.25", linewidth=0.2, linestyle="-")
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(f"{level} %: {len(mesh.points)} nodes,\n{len(mesh.cells)} triangles", fontsize=8)


def draw_mode(axes: Any, results: Results, loss: Loss, mode: str, noisy: bool) -> None:
    """Stress over stretch in one mode: a curve a resolution, the truth, the calibrated range."""
    levels = results.settings.resolutions
    looks = zip(levels, ["#0072B2", "#009E73", "#E69F00", "#D55E00"], ["-", "--", "-.", ":"], strict=False)
    count = 0
    for level, colour, stroke in looks:
        curves = [fit.curves[mode] for fit in results.fits(loss, noisy, resolution=level).values() if fit.curves]
        count = max(count, len(curves))
        if curves:
            draw_curves(axes, curves, colour, stroke, f"{level} % of the nodes")
    reference = next(fit.curves for fit in results.fits(Loss.WEIGHTED).values() if fit.curves)[mode]
    axes.plot(reference.stretch, reference.truth, color="black", linewidth=0.9, label="truth")
    style.mark_range(axes, 1.0, reference.limit)
    top = 1.6 * max(reference.truth)
    axes.set_ylim(-0.05 * top, top)
    axes.set_title(f"{TITLES[mode]}, " + (f"with noise ({count} seeds)" if noisy else "without noise"))


def draw_curves(axes: Any, curves: list[Curve], colour: str, stroke: str, label: str) -> None:
    """Median over seeds, with the range from the lowest to the highest shaded."""
    stretch, stress = np.array(curves[0].stretch), np.array([curve.stress for curve in curves], dtype=float)
    axes.plot(stretch, np.median(stress, axis=0), color=colour, linestyle=stroke, label=label)
    if len(curves) > 1:
        axes.fill_between(stretch, stress.min(axis=0), stress.max(axis=0), color=colour, alpha=0.2, linewidth=0)


def page(results: Results) -> Page:
    """The report."""
    settings, rows = results.settings, rows_of(results)
    fits = [[float(case.resolution), case.seed, fit.reduced_chi_square, fit.summary["reason"], fit.seconds]
            for case, fit in results.fits(Loss.WEIGHTED).items()]  # fmt: skip
    limit = results.cases[0].calibrated_I1
    note = [Text(WORDS.one_invariant())] if settings.inputs == "I1" else []
    beside = claims_section(claims(results, rows))
    pictures = [Picture(f"resolution_{loss}", partial(draw, results, loss), WORDS.figure()) for loss in results.losses]
    return Page("Resolution study", WORDS.question(), [
        Section("", [Text(WORDS.method(settings=settings, limit=limit))]),
        Section("Targets", [Table(TARGET_COLUMNS, targets(rows), WORDS.targets())]),
        Section(beside.heading, [*beside.parts, *note]),
        Section("Predictions", pictures),
        Section("All numbers", [
            Table(COLUMNS, [row.cells() for row in rows], COMMON.settings_caption(losses=results.losses), "resolution.csv"),
            Table(FIT_COLUMNS, fits, "Fits of the default loss"),
        ]),
    ])  # fmt: skip


def losses_with(dependent_seeds: int) -> tuple[Loss, ...]:
    """Losses of the study; the dependent scaling only where some seed is fitted with it."""
    return (Loss.WEIGHTED, Loss.POLISHED, Loss.FROZEN, *([Loss.DEPENDENT] if dependent_seeds else []))


DEFAULT = Settings("resolution", resolutions=("100", "50", "25", "12.5"), nodes=9500, losses=losses_with(2),
                   dependent_seeds=2, polished=("12.5",), forward_size=0.5)  # fmt: skip
QUICK = replace(DEFAULT, nodes=2500, resolutions=("100", "25"), seeds=(0, 1), losses=losses_with(0), dependent_seeds=0,
                polished=(), starts=8, forward_size=1.0)  # fmt: skip
RESOLUTION = Preset(DEFAULT, QUICK, page)
