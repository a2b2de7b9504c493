"""Table, figure and report of a sweep from its cases.

In: a folder with ``cases/*/*.json`` as `studies.grid.sweep_case` writes them. Out: ``sweep.csv`` (one row a case),
``sweep.png`` (median bias by thickness and resolution, for each specimen and noise), their manifest, ``report.html``.
Medians and ranges are over noise seeds, of the mode of loading in which the median bias is largest.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.equations.deformation_modes import MODES
from studies.errors import DamagedFileError
from studies.grid.sweep_case import PLANE, Settings
from studies.output import Manifest, style, write_csv, write_figure
from studies.output.report import Report

CASE_COLUMNS = ("specimen", "thickness (mm)", "resolution (%)", "noise (mm)", "seed", "nodes", "calibrated I1",
                *(f"bias {mode} (%)" for mode in MODES), "largest error (%)", "force error (%)", "reduced chi-square",
                "seconds", "failed")  # fmt: skip
COLUMNS = ("specimen", "thickness (mm)", "resolution (%)", "noise (mm)", "fits", "failed", "mode", "bias median (%)",
           "bias min (%)", "bias max (%)", "force error median (%)", "reduced chi-square median")  # fmt: skip
MOST_COLOUR = 5.0  # % of bias at which the colours of the figure end, whatever lies beyond
PALE = 0.35  # of the range of colours, within which text is black


def write(folder: Path, settings: Settings) -> Path:
    """Write everything, the report last; returns its path."""
    cases = load(folder, settings)
    manifest = Manifest(
        seed=list(settings.seeds), settings=asdict(settings), inputs=[c.path(folder) for c in settings.cases]
    )
    rows, summary = case_rows(cases), table(cases)
    write_csv(folder / "sweep.csv", CASE_COLUMNS, rows, ["stresses are judged up to the I1 given"])
    draw(summary, settings, folder / "sweep.png")
    manifest.beside(folder / "sweep.csv", folder / "sweep.png")
    return compose(folder, settings, cases, summary)


def load(folder: Path, settings: Settings) -> list[dict[str, Any]]:
    """Every case, in the order of the settings. Raises `DamagedFileError`."""
    found = []
    for case in settings.cases:
        path = case.path(folder)
        try:
            content = json.loads(path.read_text())
            found.append({**content, **asdict(case)})
        except (OSError, ValueError, TypeError) as error:
            raise DamagedFileError(f"{path}: damaged; delete it and run the same command again") from error
    return found


def case_rows(cases: Sequence[dict[str, Any]]) -> list[list[Any]]:
    """One row a case; see `CASE_COLUMNS`."""
    rows = []
    for case in cases:
        keys = [
            *(case[key] for key in ("specimen", "thickness", "resolution", "noise", "seed", "nodes", "calibrated_I1"))
        ]
        if "failed" in case:
            rows.append([*keys, *[None] * (len(CASE_COLUMNS) - len(keys) - 1), case["failed"]])
            continue
        scores = case["inside"]
        rows.append([
            *keys, *(100 * s["bias"] for s in scores), 100 * max(s["max_error"] for s in scores),
            100 * case["relative_force_error"], case["reduced_chi_square"], case["seconds"], None,
        ])  # fmt: skip
    return rows


def table(cases: Sequence[dict[str, Any]]) -> list[list[Any]]:
    """One row for each specimen, thickness, resolution and noise; see `COLUMNS`."""
    groups: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for case in cases:
        groups.setdefault((case["specimen"], case["thickness"], case["resolution"], case["noise"]), []).append(case)
    return [[*key, *_summary(group)] for key, group in groups.items()]


def _summary(group: Sequence[dict[str, Any]]) -> list[Any]:
    """Numbers of cases that differ in their seed only."""
    fits = [case for case in group if "failed" not in case]
    failed = len(group) - len(fits)
    if not fits:
        return [0, failed, *[None] * 6]
    bias = 100 * np.array([[score["bias"] for score in case["inside"]] for case in fits])
    worst = int(np.abs(np.median(bias, axis=0)).argmax())
    chi = [case["reduced_chi_square"] for case in fits if case["reduced_chi_square"] is not None]
    return [
        len(fits), failed, tuple(MODES)[worst], float(np.median(bias[:, worst])), float(bias[:, worst].min()),
        float(bias[:, worst].max()), 100 * float(np.median([case["relative_force_error"] for case in fits])),
        float(np.median(chi)) if chi else None,
    ]  # fmt: skip


def draw(summary: Sequence[Sequence[Any]], settings: Settings, path: Path) -> None:
    """Median bias in colours and numbers: a row a specimen, a column a noise; resolution to the right, thickness up."""
    known = {tuple(row[:4]): row[COLUMNS.index("bias median (%)")] for row in summary}
    largest = max((abs(bias) for bias in known.values() if bias is not None), default=0.0)
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
        figure.colorbar(
            image, ax=grid, label="median bias of the stress (%)", extend="both" if largest > limit else "neither"
        )
        write_figure(path, figure)


def heatmap(axes: Any, values: NDArray[np.float64], limit: float) -> Any:
    """Colours from -limit to limit with the numbers (m, n) on them, NaN left blank; returns the image."""
    image = axes.imshow(values, cmap=style.DIVERGING, vmin=-limit, vmax=limit, aspect="auto", origin="lower")
    axes.grid(False)
    for (i, j), value in np.ndenumerate(values):
        if np.isfinite(value):
            colour = "black" if abs(value) < 2 * PALE * limit else "white"
            axes.text(j, i, f"{value:.2f}", ha="center", va="center", fontsize=7.5, color=colour)
    return image


def compose(
    folder: Path, settings: Settings, cases: Sequence[dict[str, Any]], summary: Sequence[Sequence[Any]]
) -> Path:
    """The HTML report."""
    report = Report("Sweep", f"{len(cases)} calibrations over specimen, thickness, resolution, noise and noise seed")
    report.paragraph(
        f"Specimens of Arruda-Boyce rubber ({settings.displacement:g} mm pulled at each arm of the cross, others in proportion, "
        f"{settings.increments} increments) were solved in plane stress ({PLANE}, 1 mm thick) or in 3D, seen by a camera on at most "
        f"{settings.nodes} nodes, and calibrated as if they were thin. Noise: standard deviation as given, correlated over 4 mm, "
        "new in every increment; forces to 1e-4. Coarser data are the finest ones, noise included, projected. Bias is the mean "
        "stress error over the mean stress, on equidistant stretches up to the 99.9 % quantile of I1 in the clean data of the "
        "same specimen and thickness at the finest resolution; of uniaxial, equi-biaxial and pure shear, where its median is largest."
    )
    if len(settings.seeds) < 10:
        report.paragraph(
            f"With {len(settings.seeds)} noise seeds this is a reduced run: its medians and ranges prove little."
        )
    for text in findings(summary):
        report.paragraph(text)
    report.figure(
        folder / "sweep.png", "Median over noise seeds of the bias of the stress, %. Blank: nothing could be fitted."
    )
    report.table(COLUMNS, summary, "Median and range over noise seeds; every case is in sweep.csv")
    failures = [
        [c["specimen"], c["thickness"], c["resolution"], c["noise"], c["seed"], c["failed"]]
        for c in cases
        if "failed" in c
    ]
    if failures:
        report.heading("Cases without a model").table((*COLUMNS[:4], "seed", "why"), failures)
    report.details("Settings", asdict(settings))
    return report.save(folder / "report.html")


def findings(summary: Sequence[Sequence[Any]]) -> list[str]:
    """Where the bias is largest, and where it spreads most over seeds, by specimen."""
    texts = []
    for specimen in dict.fromkeys(row[0] for row in summary):
        rows = [row for row in summary if row[0] == specimen and row[4]]
        if not rows:
            continue
        worst = max(rows, key=lambda row: abs(row[7]))
        text = f"{specimen.replace('_', ' ')}: the largest median bias is {worst[7]:+.2f} % ({_where(worst)})"
        noisy = [row for row in rows if row[4] > 1]
        if noisy:
            wide = max(noisy, key=lambda row: row[9] - row[8])
            text += f"; it spreads most over seeds, from {wide[8]:+.2f} to {wide[9]:+.2f} %, at {_where(wide)}"
        texts.append(text + ".")
    return texts


def _where(row: Sequence[Any]) -> str:
    thickness = row[1] if row[1] == PLANE else f"{row[1]} mm thick"
    return f"{thickness}, {row[2]} % of the nodes, noise {row[3]} mm"
