"""`equigap homogeneous`: a measured stress-stretch curve to an Experiment, by name or from a CSV; with a figure and a report."""

from __future__ import annotations

import argparse
from pathlib import Path

from calibrate.errors import ConfigError
from studies.commands.options import add_output, nearest, settings

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
    from studies.output import Manifest, open_output_folder
    from studies.sheets.homogeneous_experiments import EXPERIMENTS, from_file
    from studies.sheets.homogeneous_report import write_report

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
    report = write_report(experiment, folder, manifest)
    manifest.beside(path, folder / "curve.png", increments=experiment.n_increments, **experiment.provenance)
    print(f"experiment: {path} ({experiment.n_increments} increments)\nreport: {report}")
    return 0
