"""`equigap supervised`: PANNs fitted to stress-stretch curves of homogeneous tests (Sobolev fit), and their r2.

In: the five-term Arruda-Boyce material sampled in the three modes, and classical measurements. Out: a table of r2
by mode, a figure of every data set, the models, a manifest beside each, ``report.html``.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path

from calibrate import errors
from studies.commands.options import count, seed
from studies.importers import homogeneous_curves
from studies.output import Manifest, open_output_folder, track
from studies.reports.supervised.report import write
from studies.reports.supervised.supervised_fits import TRUTH, Case, default_cases, run, short_r2

DESCRIPTION = "Fit PANNs to stress-stretch curves of homogeneous tests."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `equigap supervised`."""
    parser.add_argument(
        "--data", nargs="+", metavar="NAME", help=f"data sets: {TRUTH}, {', '.join(homogeneous_curves.COLLECTIONS)}"
    )
    parser.add_argument("--inputs", choices=("I1", "I2", "I1I2"), help="one set of inputs instead of the default cases")
    parser.add_argument("--layers", type=_layers, metavar="N,N", help="one network size instead of the default cases")
    parser.add_argument("--starts", type=count, default=10, help="random starts (%(default)s)")
    parser.add_argument("--seed", type=seed, default=0, help="seed of the starts (%(default)s)")
    parser.add_argument("--quick", action="store_true", help="fewer cases and starts")
    parser.add_argument("-o", "--output", type=Path, default=Path("results/supervised"), help="folder (%(default)s)")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier run in that folder")


def _layers(text: str) -> tuple[int, ...]:
    try:
        return tuple(count(part) for part in text.split(","))
    except (argparse.ArgumentTypeError, ValueError):
        raise argparse.ArgumentTypeError(
            f"'{text}': give whole numbers above 0 separated by commas, as in 8,8"
        ) from None


def cases_of(args: argparse.Namespace) -> list[Case]:
    """Cases asked for on the command line. Raises `ConfigError` for an unknown data set."""
    cases = default_cases(args.quick)
    if args.data:
        known = {TRUTH, *homogeneous_curves.COLLECTIONS}
        for name in args.data:
            if name not in known:
                raise errors.ConfigError(f"data set '{name}' unknown; choose one of {', '.join(sorted(known))}")
        networks = list(dict.fromkeys((c.inputs, c.layers) for c in cases))
        cases = [Case(name, *network) for name in args.data for network in networks]
    if args.inputs or args.layers:
        cases = [Case(c.data, args.inputs or c.inputs, args.layers or c.layers) for c in cases]
    return list(dict.fromkeys(cases))


def main(args: argparse.Namespace) -> int:
    """Fit every case, write table, figures, models and manifests; raises named errors."""
    cases = cases_of(args)
    starts = min(args.starts, 4) if args.quick else args.starts
    settings = {
        "study": "supervised",
        "cases": [asdict(c) for c in cases],
        "starts": starts,
        "seed": args.seed,
    }
    folder = open_output_folder(args.output, args.overwrite, settings)
    manifest = Manifest(seed=args.seed, settings=settings)
    results = [run(case, starts, args.seed) for case in track(cases, "supervised fits", unit="fits")]
    report = write(folder, results, manifest)
    for r in results:
        print(f"{r.case.name:28s} " + "  ".join(f"{mode} r2 {short_r2(value)}" for mode, value in r.r2.items()))
    print(f"wrote {folder / 'supervised.csv'}\nreport: {report}")
    return 0
