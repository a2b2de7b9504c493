"""`equigap supervised`: PANNs fitted to stress-stretch curves of homogeneous tests (Sobolev fit), and their r2.

In: the five-term Arruda-Boyce material sampled in the three modes, and classical measurements. Out: a table of r2
by mode, a figure of every data set, the models, a manifest beside each, ``report.html``.

The Arruda-Boyce case checks the path: one neuron with skip connection on I1 alone must reach r2 > 0.9999 in all
three modes. On measured rubber r2 is limited by the model class and by scatter: a PANN of I1 alone cannot
distinguish modes at equal I1.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.equations.deformation_modes import MODES, largest_stretch, nominal_stress
from calibrate.fitting.sobolev_fit import Curves, fit_supervised
from calibrate.models.network_model import Model
from studies.accuracy.metrics import ArrudaBoyceTruth, r2
from studies.commands.options import count, seed
from studies.importers import homogeneous_curves
from studies.output import write_csv, write_figure
from studies.output.folder import open_output_folder
from studies.output.manifest import Manifest
from studies.output.progress import track

DESCRIPTION = "Fit PANNs to stress-stretch curves of homogeneous tests."
Array = NDArray[np.float64]
TRUTH = "arruda-boyce"
TARGET_R2, TRUTH_I1, TRUTH_POINTS = 0.9999, 20.0, 50
COLUMNS = ("data", "inputs", "layers", "mode", "points", "largest_stretch", "r2", "loss", "why_stopped")


@dataclass(frozen=True)
class Case:
    """One fit: a data set and the network PANN_inputs^layers."""

    data: str
    inputs: str
    layers: tuple[int, ...]

    @property
    def name(self) -> str:
        """Data, inputs and layers, as its files are called."""
        return f"{self.data}-{self.inputs}-{'-'.join(map(str, self.layers))}"


@dataclass(frozen=True)
class Result:
    """A fitted case: r2 by mode, loss, why the optimiser stopped."""

    case: Case
    model: Model
    r2: dict[str, float]
    loss: float
    reason: str


def default_cases(quick: bool = False) -> list[Case]:
    """One neuron on Arruda-Boyce; both transcriptions of Treloar's data with I1 alone and with both invariants."""
    cases = [Case(TRUTH, "I1", (1,))]
    measured = ["treloar-a", "treloar-b"] + ([] if quick else ["kawabata"])
    networks = [("I1", (4,))] if quick else [("I1", (1,)), ("I1", (4, 4)), ("I1I2", (4,)), ("I1I2", (4, 4))]
    return cases + [Case(name, inputs, layers) for name in measured for inputs, layers in networks]


def curves_of(name: str) -> Curves:
    """{mode: (stretch, nominal stress MPa)} of a data set, the Arruda-Boyce material up to I1 = 20 included."""
    if name != TRUTH:
        return homogeneous_curves.load(name)
    truth = ArrudaBoyceTruth()
    stretches = {mode: np.linspace(1.0, largest_stretch(mode, TRUTH_I1), TRUTH_POINTS) for mode in MODES}
    return {mode: (stretch, nominal_stress(truth, mode, stretch)) for mode, stretch in stretches.items()}


def run(case: Case, starts: int = 10, seed: int = 0) -> Result:
    """Fit one case and measure r2 in every mode."""
    curves = curves_of(case.data)
    fitted = fit_supervised(curves, case.inputs, case.layers, starts, seed)
    quality = {mode: r2(stress, fitted.model.homogeneous(mode, stretch)) for mode, (stretch, stress) in curves.items()}
    return Result(case, fitted.model, quality, fitted.loss, fitted.reason)


def table_rows(results: list[Result]) -> list[tuple[Any, ...]]:
    """Rows of the table, one a case and mode."""
    rows: list[tuple[Any, ...]] = []
    for r in results:
        for mode, (stretch, _) in curves_of(r.case.data).items():
            layers = "-".join(map(str, r.case.layers))
            place = (r.case.data, r.case.inputs, layers, mode, len(stretch), float(stretch.max()))
            rows.append((*place, r.r2[mode], r.loss, r.reason))
    return rows


def figure(name: str, results: list[Result]) -> Any:
    """Stress against stretch in the three modes: data and every network fitted to them."""
    from studies.output import style

    curves = curves_of(name)
    with style.figure(11, 3.6) as drawn:
        _draw(drawn, name, curves, results)
    return drawn


def _draw(drawn: Any, name: str, curves: Curves, results: list[Result]) -> None:
    for ax, (mode, (stretch, stress)) in zip(
        drawn.subplots(1, len(curves), squeeze=False)[0], curves.items(), strict=False
    ):
        ax.plot(stretch, stress, "o", color="0.3", markersize=3.5, label="truth" if name == TRUTH else "measured")
        fine = np.linspace(min(1.0, float(stretch.min())), float(stretch.max()), 200)
        for r in results:
            layers = ", ".join(map(str, r.case.layers))
            label = f"{r.case.inputs.replace('I1I2', 'I1, I2')} ({layers}): r2 {_short(r.r2[mode])}"
            ax.plot(fine, r.model.homogeneous(mode, fine), linewidth=1.2, label=label)
        ax.set(
            xlabel="stretch",
            ylabel="nominal stress (MPa)",
            title=mode.replace("_", " ").replace("equib", "equi-b"),
        )
        ax.legend(fontsize=7)
    drawn.suptitle(homogeneous_curves.SOURCES.get(name, "five-term Arruda-Boyce"), fontsize=9)


def _short(value: float) -> str:
    return f"{value:.4f}" if value < TARGET_R2 else f"1 - {1 - value:.0e}"


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
    outputs = [folder / "supervised.csv"]
    write_csv(outputs[0], COLUMNS, table_rows(results), [f"starts {starts}, seed {args.seed}"])
    for r in results:
        r.model.save(folder / "models" / f"{r.case.name}.json")
    for name in dict.fromkeys(c.data for c in cases):
        outputs.append(folder / f"{name}.png")
        write_figure(outputs[-1], figure(name, [r for r in results if r.case.data == name]), dpi=150)
        manifest.beside(outputs[-1])
    manifest.beside(*outputs, r2={r.case.name: r.r2 for r in results})
    _say(results, print)
    print(f"wrote {outputs[0]}\nreport: {_report(folder, results, outputs[1:], manifest)}")
    return 0


def _say(results: list[Result], write: Callable[[str], None]) -> None:
    for r in results:
        write(f"{r.case.name:28s} " + "  ".join(f"{mode} r2 {_short(value)}" for mode, value in r.r2.items()))


def _report(folder: Path, results: list[Result], pictures: list[Path], manifest: Manifest) -> Path:
    """The HTML report: what was fitted, how well, and where it departs."""
    from studies.output.report import Report

    report = Report("Supervised fits", "Networks fitted directly to stress-stretch curves of homogeneous tests")
    report.paragraph(
        "r2 of the nominal stress in each mode. On measured rubber it is limited by scatter and by the kind of model: "
        "a network of I1 alone cannot tell modes apart at equal I1."
    )
    for path in pictures:
        report.figure(path, f"{path.stem}: nominal stress over stretch, data (dots) and every network fitted to them.")
    report.table(COLUMNS, table_rows(results), "Also in supervised.csv")
    record = manifest.to_dict()
    report.details("Settings", record["settings"]).details("Versions", record["versions"])
    return report.save(folder / "report.html")
