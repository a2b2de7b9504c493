"""Figure and report of a homogeneous test as an Experiment."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from calibrate.data.experiment import Experiment
from studies.output import Manifest, style, write_figure
from studies.output.report import Report
from studies.output.words import Words
from studies.sheets.homogeneous.homogeneous_sheet import CROSS_SECTION, WIDTH, stresses, stretches

WORDS = Words("homogeneous")


def write_report(experiment: Experiment, folder: Path, manifest: Manifest) -> Path:
    """``curve.png`` and ``report.html``: the curve and every reading; returns the path of the report."""
    write_figure(folder / "curve.png", draw_curve(experiment))
    page = Report(experiment.name, "A homogeneous test as an Experiment").figure(folder / "curve.png", WORDS.figure())
    noise = experiment.noise
    if noise is not None:
        stretch, stress = noise.displacement_std / WIDTH, noise.force_std / CROSS_SECTION
        page.paragraph(WORDS.noise(stretch=stretch, relative=noise.force_std_relative, stress=stress))
    x, y, time = stretches(experiment), stresses(experiment), experiment.time
    rows = [
        [i + 1, None if time is None else float(time[i]), *map(float, (*x[i], *y[i]))]
        for i in range(experiment.n_increments)
    ]
    columns = ["increment", "time, s", "stretch x", "stretch y", "stress x, MPa", "stress y, MPa"]
    page.table(columns, rows, WORDS.table())
    page.details("Source", experiment.provenance).details("Versions", manifest.to_dict()["versions"])
    return page.save(folder / "report.html")


def draw_curve(experiment: Experiment) -> Figure:
    """Nominal stress over stretch along each axis that has a measured stress."""
    x, y = stretches(experiment), stresses(experiment)
    with style.figure(5.2, 3.6) as figure:
        axes = figure.subplots()
        for i, marker in enumerate("ox"):
            if np.isfinite(y[:, i]).any():
                axes.plot(x[:, i], y[:, i], marker, mfc="none", linestyle="", label=f"along {'xy'[i]}")
        axes.set(xlabel="stretch", ylabel="nominal stress, MPa", title=experiment.name)
        axes.legend()
    return figure
