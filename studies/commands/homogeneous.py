"""`equigap homogeneous`: a measured stress-stretch curve to an Experiment, by name or from a CSV; with a figure and a report."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibrate.errors import ConfigError
from studies.commands.options import add_output, nearest, settings

if TYPE_CHECKING:
    from calibrate.data.experiment import Experiment
    from studies.output.manifest import Manifest

DESCRIPTION = """\
Write homogeneous tests (stress and stretch) as Experiments, for `equigap calibrate`. The sheet is 10 mm x 1 mm in
cross-section. Noise is estimated from the scatter of the curve."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `equigap homogeneous`."""
    from studies.sheets.homogeneous_experiments import EXPERIMENTS, MODES

    parser.add_argument(
        "source",
        help=f"a .csv with the columns stretch, stress (time) or lambda1, lambda2, P1_MPa, P2_MPa, or one of: {', '.join(EXPERIMENTS)}",
    )
    parser.add_argument("--mode", default="uniaxial", choices=tuple(MODES), help="of a .csv (%(default)s)")
    add_output(parser, "homogeneous-NAME")


def main(args: argparse.Namespace) -> int:
    """Write experiment.npz. Raises `ConfigError`, `DataNotFoundError` and the errors of an Experiment."""
    from studies.output import Manifest, open_output_folder, write_figure
    from studies.sheets.homogeneous_experiments import EXPERIMENTS, from_file

    if args.source in EXPERIMENTS:
        experiment = EXPERIMENTS[args.source]()
    elif args.source.endswith(".csv"):
        experiment = from_file(args.source, args.mode)
    else:
        raise ConfigError(
            f"test '{args.source}' unknown{nearest(args.source, EXPERIMENTS)}; give a .csv or one of "
            + ", ".join(EXPERIMENTS)
        )
    output = args.output or Path("results") / f"homogeneous-{Path(args.source).stem}"
    key = settings(args)
    folder = open_output_folder(output, args.overwrite, key)
    manifest = Manifest(settings=key)
    path = folder / "experiment.npz"
    experiment.save(path)
    write_figure(folder / "curve.png", curve(experiment))
    manifest.beside(path, folder / "curve.png", increments=experiment.n_increments, **experiment.provenance)
    print(f"experiment: {path} ({experiment.n_increments} increments)")
    print(f"report: {write_report(experiment, folder, manifest)}")
    return 0


def curve(experiment: Experiment) -> Any:
    """Nominal stress over stretch along each axis that has a measured stress."""
    import numpy as np

    from studies.output import style
    from studies.sheets.homogeneous_sheet import stresses, stretches

    x, y = stretches(experiment), stresses(experiment)
    with style.figure(5.2, 3.6) as figure:
        axes = figure.subplots()
        for i, marker in enumerate("ox"):
            if np.isfinite(y[:, i]).any():
                axes.plot(x[:, i], y[:, i], marker, mfc="none", linestyle="", label=f"along {'xy'[i]}")
        axes.set(xlabel="stretch", ylabel="nominal stress, MPa", title=experiment.name)
        axes.legend()
        return figure


def write_report(experiment: Experiment, folder: Path, manifest: Manifest) -> Path:
    """``report.html``: the curve and every reading."""
    from studies.output.report import Report
    from studies.sheets.homogeneous_sheet import CROSS_SECTION, WIDTH, stresses, stretches

    page = Report(experiment.name, "A homogeneous test as an Experiment")
    page.figure(folder / "curve.png", "Nominal stress over stretch, as it will be fitted.")
    noise = experiment.noise
    if noise is not None:
        page.paragraph(
            f"Noise: {noise.displacement_std / WIDTH:.2g} in stretch, {noise.force_std_relative:.2g} of the stress, "
            f"and {noise.force_std / CROSS_SECTION:.2g} MPa."
        )
    x, y, time = stretches(experiment), stresses(experiment), experiment.time
    rows = [
        [i + 1, None if time is None else float(time[i]), *map(float, (*x[i], *y[i]))]
        for i in range(experiment.n_increments)
    ]
    columns = ["increment", "time, s", "stretch x", "stretch y", "stress x, MPa", "stress y, MPa"]
    page.table(columns, rows, "Empty: not measured")
    page.details("Source", experiment.provenance).details("Versions", manifest.to_dict()["versions"])
    return page.save(folder / "report.html")
