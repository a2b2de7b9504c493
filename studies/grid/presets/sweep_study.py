"""The sweep: specimens x thicknesses x resolutions x noises x seeds, the default loss, small results.

In: `Results`. Out: the page of its report: ``sweep.csv`` (one row a case) and the median bias by thickness and resolution,
for each specimen and noise. Medians and ranges are over noise seeds, of the mode in which the median bias is largest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.equations.deformation_modes import MODES
from studies.grid.axes import PLANE, Settings
from studies.grid.case import CaseResult
from studies.grid.report import Page, Picture, Section, Table, Text
from studies.grid.results import Results, Spread, median_biases
from studies.grid.study import Preset
from studies.output import style
from studies.output.words import Words

WORDS = Words("sweep")
KEYS = ("specimen", "thickness (mm)", "resolution (%)", "noise (mm)")
CASE_COLUMNS = (*KEYS, "seed", "nodes", "calibrated I1", *(f"bias {mode} (%)" for mode in MODES), "largest error (%)",
                "force error (%)", "reduced chi-square", "seconds", "failed")  # fmt: skip
COLUMNS = (*KEYS, "fits", "failed", "mode", "bias median (%)", "bias min (%)", "bias max (%)", "force error median (%)",
           "reduced chi-square median")  # fmt: skip
MOST_COLOUR = 5.0  # % of bias at which the colours of the figure end
PALE = 0.35  # of the range of colours, within which text is black


@dataclass(frozen=True)
class Group:
    """Cases that differ in their seed only. keys: as in `KEYS`. bias: %, in `mode`; None where nothing was fitted."""

    keys: tuple[str, str, str, str]
    fits: int
    failed: int
    mode: str = ""
    bias: Spread | None = None
    force_error: float | None = None
    reduced_chi_square: float | None = None

    def row(self) -> list[Any]:
        """See `COLUMNS`."""
        bias = [None] * 3 if self.bias is None else [self.bias.median, self.bias.low, self.bias.high]
        return [*self.keys, self.fits, self.failed, self.mode or None, *bias, self.force_error, self.reduced_chi_square]


def groups(cases: Sequence[CaseResult]) -> list[Group]:
    """One for each specimen, thickness, resolution and noise."""
    found: dict[tuple[str, ...], list[CaseResult]] = {}
    for case in cases:
        found.setdefault(astuple(case.case)[:4], []).append(case)
    return [_group(keys, members) for keys, members in found.items()]


def _group(keys: Any, members: Sequence[CaseResult]) -> Group:
    fits = [fit for case in members for fit in case.losses.values()]
    failed = len(members) - len(fits)
    if not fits:
        return Group(keys, 0, failed)
    worst = int(np.abs(median_biases(fits)).argmax())
    bias = Spread.of(100 * fit.inside[worst].bias for fit in fits)
    chi = [fit.reduced_chi_square for fit in fits if fit.reduced_chi_square is not None]
    force = 100 * float(np.median([fit.force_error for fit in fits]))
    return Group(keys, len(fits), failed, [*MODES][worst], bias, force, float(np.median(chi)) if chi else None)


def case_row(result: CaseResult) -> list[Any]:
    """See `CASE_COLUMNS`."""
    keys = [*astuple(result.case), result.nodes, result.calibrated_I1]
    if result.failed is not None:
        return [*keys, *[None] * (len(CASE_COLUMNS) - len(keys) - 1), result.failed]
    (fit,) = result.losses.values()
    biases = [100 * score.bias for score in fit.inside]
    largest = 100 * max(score.max_error for score in fit.inside)
    return [*keys, *biases, largest, 100 * fit.force_error, fit.reduced_chi_square, fit.seconds, None]


def extremes(found: Sequence[Group]) -> list[list[Any]]:
    """Rows of `COLUMNS` with what makes them worth a look, two a specimen at most."""
    rows = []
    for specimen in dict.fromkeys(group.keys[0] for group in found):
        known = [(group, group.bias) for group in found if group.keys[0] == specimen and group.bias is not None]
        if known:
            rows.append(["largest median", *max(known, key=lambda pair: abs(pair[1].median))[0].row()])
        several = [(group, bias) for group, bias in known if bias.count > 1]
        if several:
            rows.append(["widest range", *max(several, key=lambda pair: pair[1].high - pair[1].low)[0].row()])
    return rows


def draw(found: Sequence[Group], settings: Settings) -> Any:
    """Median bias in colours and numbers: a row a specimen, a column a noise; resolution to the right, thickness up."""
    known = {group.keys: np.nan if group.bias is None else group.bias.median for group in found}
    largest = float(np.nanmax(np.abs([*known.values(), 0.0])))
    limit = min(MOST_COLOUR, largest) or 1.0
    rows, columns = len(settings.specimens), len(settings.noises)
    with style.figure(1.2 + 2.4 * columns, 0.6 + 2.1 * rows) as figure:
        grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        for specimen, line in zip(settings.specimens, grid, strict=True):
            for noise, axes in zip(settings.noises, line, strict=True):
                values = [[known[specimen, h, r, noise] for r in settings.resolutions] for h in settings.thicknesses]
                image = heatmap(axes, np.array(values, dtype=float), limit)
                axes.set_title(f"{specimen.replace('_', ' ')}, {'no noise' if noise == '0' else f'noise {noise} mm'}")
                axes.set_xticks(range(len(settings.resolutions)), settings.resolutions)
                axes.set_yticks(range(len(settings.thicknesses)), settings.thicknesses)
            line[0].set_ylabel("thickness (mm)")
        for axes in grid[-1]:
            axes.set_xlabel("nodes kept (%)")
        ends = "both" if largest > limit else "neither"
        figure.colorbar(image, ax=grid, label="median bias of the stress (%)", extend=ends)
    return figure


def heatmap(axes: Any, values: NDArray[np.float64], limit: float) -> Any:
    """Colours from -limit to limit with the numbers (m, n) on them, NaN left blank; returns the image."""
    image = axes.imshow(values, cmap=style.DIVERGING, vmin=-limit, vmax=limit, aspect="auto", origin="lower")
    axes.grid(False)
    for (i, j), value in np.ndenumerate(values):
        if np.isfinite(value):
            colour = "black" if abs(value) < 2 * PALE * limit else "white"
            axes.text(j, i, f"{value:.2f}", ha="center", va="center", fontsize=7.5, color=colour)
    return image


def page(results: Results) -> Page:
    """The report."""
    settings, cases = results.settings, results.cases
    found = groups(cases)
    every = Table(CASE_COLUMNS, [case_row(case) for case in cases], file="sweep.csv", shown=False)
    failures = [[*astuple(case.case), case.failed] for case in cases if case.failed is not None]
    sections = [
        Section("", [
            Text(WORDS.method(settings=settings)), every,
            Table(("", *COLUMNS), extremes(found), WORDS.extremes()),
            Picture("sweep", lambda: draw(found, settings), WORDS.figure()),
            Table(COLUMNS, [group.row() for group in found], WORDS.summary()),
        ]),
    ]  # fmt: skip
    if failures:
        sections.append(Section("Cases without a model", [Table((*KEYS, "seed", "why"), failures)]))
    return Page("Sweep", WORDS.question(cases=len(cases)), sections)


DEFAULT = Settings("sweep", nodes=9500, specimens=("cross", "plate_with_hole"), thicknesses=(PLANE, "10", "20", "40"),
                   resolutions=("100", "50", "25", "12.5"), noises=("0", "0.05", "0.1", "0.2"), keep_all=False,
                   record_failures=True)  # fmt: skip
QUICK = replace(DEFAULT, nodes=2500, seeds=(0, 1), starts=8, specimens=("cross",), thicknesses=(PLANE, "10"),
                resolutions=("100", "25"), noises=("0", "0.1"))  # fmt: skip
SWEEP = Preset(DEFAULT, QUICK, page)
