"""`equigap calibrate`: an Experiment in, a model with its evidence out.

Out: ``model.json`` (read by `equigap predict` and by the forward models), ``report.html``, its figures as PNG, a
table of forces ``forces.csv``, and a manifest with every setting and result.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING

from studies.commands.options import add_output, count, output_folder, positive, seed

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from calibrate.data.experiment import Experiment
    from calibrate.fitting.calibration import Options

DESCRIPTION = """\
Identify a neural-network hyperelastic model from an Experiment (.npz of `equigap import` or `simulate`).
Stresses come out in MPa, or in N/mm (stress times thickness) where the thickness is unknown."""
HOLD_OUT = 0.3
QUICK_STARTS, QUICK_INCREMENTS = 4, 6


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `equigap calibrate`."""
    parser.add_argument("experiment", type=Path, metavar="EXPERIMENT.npz", help="what was measured or simulated")
    model = parser.add_argument_group("model")
    model.add_argument("--inputs", choices=("I1", "I2", "I1I2"), default="I1", help="invariants (default: I1)")
    model.add_argument("--layers", default="4,4", metavar="N,N", help="neurons of each layer (default: 4,4)")
    fit = parser.add_argument_group("fit")
    fit.add_argument(
        "--loss", choices=("weighted", "paper"), default="weighted",
        help="weighted by the noise on coarse virtual fields (default), or the plain equilibrium gap",
    )  # fmt: skip
    fit.add_argument(
        "--scaling", choices=("frozen", "dependent"), default="frozen",
        help="of the paper's loss: scale of the nodal forces held, or following the model (default: frozen)",
    )  # fmt: skip
    fit.add_argument("--spacing", type=positive, metavar="MM", help="of the virtual fields (default: from the noise)")
    fit.add_argument("--starts", type=count, default=20, metavar="N", help="random starts (default: 20)")
    fit.add_argument("--seed", type=seed, default=0, help="of the random starts (default: 0)")
    fit.add_argument(
        "--hold-out", metavar="last|random[:SHARE]",
        help=f"leave increments out of the fit and score the model on them (share: {HOLD_OUT})",
    )  # fmt: skip
    parser.add_argument("--quick", action="store_true", help="4 starts, at most 6 increments: shows the path")
    add_output(parser, "calibrate")


def main(args: argparse.Namespace) -> int:
    """Calibrate, write everything, print a summary. Raises the named errors of `calibrate` and `studies`."""
    from calibrate.data.experiment import Experiment
    from calibrate.fitting.calibration import calibrate
    from studies.output import Manifest, callback, open_output_folder, released_if_refused
    from studies.reports.calibration.fit_review import review
    from studies.reports.calibration.report import summary_lines, write

    started = time.time()
    options = options_from(args)
    experiment = Experiment.load(args.experiment)
    if args.quick:
        experiment = experiment.select(_spread(experiment.n_increments, QUICK_INCREMENTS))
    fitted = held_in(experiment, args.hold_out, args.seed)
    settings = {k: v for k, v in vars(args).items() if k not in ("output", "overwrite", "experiment")}
    manifest = Manifest(args.seed, settings, [args.experiment], started)
    key = {**settings, "experiment": manifest.to_dict()["inputs"]}
    folder = open_output_folder(output_folder(args, "calibrate"), args.overwrite, key)
    part = experiment if fitted.all() else experiment.select(fitted.nonzero()[0])
    with released_if_refused(folder):
        calibration = calibrate(part, options, callback("assembling"))
    view = review(calibration, experiment, fitted, callback("judging residuals"))
    write(folder, view, manifest)
    for line in summary_lines(view):
        print(line)
    print(f"model: {folder / 'model.json'}\nreport: {folder / 'report.html'}")
    return 0


def options_from(args: argparse.Namespace) -> Options:
    """Options of the calibration. Raises `ConfigError`."""
    from calibrate.errors import ConfigError
    from calibrate.fitting.calibration import Options

    try:
        layers = tuple(int(n) for n in str(args.layers).split(","))
    except ValueError:
        raise ConfigError(f"--layers {args.layers}: give whole numbers with commas between, such as 4,4") from None
    starts = min(args.starts, QUICK_STARTS) if args.quick else args.starts
    return Options(args.inputs, layers, args.loss, args.scaling, args.spacing, starts, args.seed)


def held_in(experiment: Experiment, hold_out: str | None, seed: int) -> NDArray[np.bool_]:
    """Which increments (n_increments,) are used for the fit, of 'last', 'random', 'last:0.3' ... or None.

    At least one increment is left on either side. Raises `ConfigError`.
    """
    import numpy as np

    from calibrate.errors import ConfigError

    n = experiment.n_increments
    fitted = np.ones(n, bool)
    if hold_out is None:
        return fitted
    kind, _, text = hold_out.partition(":")
    try:
        share = float(text) if text else HOLD_OUT
    except ValueError:
        share = -1.0
    if kind not in ("last", "random") or not 0 < share < 1:
        raise ConfigError(f"--hold-out {hold_out}: give 'last' or 'random', with a share such as last:{HOLD_OUT}")
    if n < 2:
        raise ConfigError("--hold-out needs at least 2 increments; this experiment has 1")
    size = min(max(round(share * n), 1), n - 1)
    chosen = np.arange(n - size, n) if kind == "last" else np.random.default_rng(seed).permutation(n)[:size]
    fitted[chosen] = False
    return fitted


def _spread(n: int, most: int) -> NDArray[np.int64]:
    """At most `most` of n increments, evenly spread, the last among them."""
    import numpy as np

    size = min(n, most)
    return np.unique(np.round(np.linspace(n / size - 1, n - 1, size)).astype(np.int64))
