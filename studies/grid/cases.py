"""What the cases of the studies share: their settings and options, a fit of one Experiment, its score against the truth.

In: command-line options, an Experiment, a loss. Out: settings; the calibrated model with its agreement inside and
outside the calibrated range and stress-stretch curves, ready for a case's JSON.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from calibrate.data.experiment import Experiment
    from calibrate.fitting.calibration import Calibration

LOSSES = ("weighted", "paper-frozen", "paper-dependent")
EXTRAPOLATION = 2.0  # curves and scores outside end where I1 - 3 is this many times the calibrated range
CURVE_POINTS = 121
LEAST_NODES = 800


@dataclass(frozen=True)
class CaseSettings:
    """What fixes the results of a study. nodes: of the camera's finest triangulation. seeds: of the noise.

    dependent_seeds: how many of the seeds are fitted with the paper's loss with the dependent scaling as well,
    which takes the full data and SLSQP. inputs, layers, starts: of the network. displacement: of each arm, mm.
    forward_size: of the quads relative to the default. normalisation: of the random field.
    """

    nodes: int = 5000
    seeds: tuple[int, ...] = tuple(range(10))
    dependent_seeds: int = 0
    inputs: str = "I1"
    layers: tuple[int, ...] = (4, 4)
    starts: int = 20
    displacement: float = 60.0
    increments: int = 10
    forward_size: float = 1.0
    normalisation: str = "unit-variance"

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Settings of an output folder."""
        stored: dict[str, Any] = json.loads((folder / "run.json").read_text())["settings"]
        content: dict[str, Any] = {key: tuple(v) if isinstance(v, list) else v for key, v in stored.items()}
        content.pop("study")
        return cls(**content)

    @property
    def noise_seeds(self) -> list[str]:
        """'clean' and every seed, as used in file names."""
        return ["clean", *map(str, self.seeds)]


def add_arguments(parser: argparse.ArgumentParser, default: CaseSettings, every_loss: bool = True) -> None:
    """Options of the camera and of the calibration. every_loss: whether the study fits others than the default one."""
    parser.add_argument("--seeds", type=int, help=f"number of noise seeds (default: {len(default.seeds)})")
    parser.add_argument("--nodes", type=int, help=f"nodes of the finest triangulation (default: {default.nodes})")
    parser.add_argument("--inputs", choices=("I1", "I2", "I1I2"), help="invariants of the network (default: I1)")
    parser.add_argument("--layers", help="neurons of each layer, e.g. 4,4 (default)")
    if every_loss:
        parser.add_argument(
            "--dependent-seeds",
            type=int,
            help="noise seeds that are also fitted with the paper's loss in "
            f"its dependent scaling by SLSQP on the full data (default: {default.dependent_seeds})",
        )
    parser.add_argument("--normalisation", choices=("unit-variance", "unit-maximum"), help="of the random field")


def with_arguments[S: CaseSettings](settings: S, arguments: argparse.Namespace) -> S:
    """`settings` with what the command line asks for. Raises `ConfigError`."""
    from calibrate.errors import ConfigError

    given = {name: getattr(arguments, name, None) for name in ("nodes", "inputs", "dependent_seeds", "normalisation")}
    settings = replace(settings, **{name: value for name, value in given.items() if value is not None})
    if arguments.seeds is not None:
        settings = replace(settings, seeds=tuple(range(arguments.seeds)))
    if arguments.layers is not None:
        try:
            settings = replace(settings, layers=tuple(int(n) for n in arguments.layers.split(",")))
        except ValueError as error:
            raise ConfigError(
                f"--layers {arguments.layers}: give whole numbers separated by commas, e.g. 4,4"
            ) from error
    few = settings.nodes < LEAST_NODES or not settings.seeds
    if few or min(settings.layers) < 1 or settings.dependent_seeds < 0:
        raise ConfigError(f"at least {LEAST_NODES} nodes, one seed and one neuron a layer are needed")
    return settings


def fit(experiment: Experiment, settings: CaseSettings, loss: str, limit: float) -> tuple[Calibration, dict[str, Any]]:
    """Calibrate with one of `LOSSES`; also what a case's JSON says of it. limit: calibrated I1 to score up to."""
    from calibrate.fitting.calibration import Options, calibrate

    name, _, scaling = loss.partition("-")
    starts = 1 if scaling == "dependent" else settings.starts
    options = Options(settings.inputs, settings.layers, name, scaling or "frozen", starts=starts)
    begin = time.perf_counter()
    result = calibrate(experiment, options)
    seconds = time.perf_counter() - begin
    content = {**score(result.model, limit), **result.summary(), "seconds": seconds, "model": result.model.to_dict()}
    return result, content


def calibrated_limit(reference: Experiment) -> float:
    """Upper end of the calibrated range of I1 in an Experiment."""
    from calibrate.equations.equilibrium import Equilibrium
    from calibrate.equations.virtual_fields import virtual_fields
    from calibrate.fitting.calibration import calibrated_range

    return calibrated_range(Equilibrium(reference, virtual_fields(reference)))["I1"][1]


def score(model: Any, limit: float) -> dict[str, Any]:
    """Agreement inside and outside the calibrated range, and stress curves, against Arruda-Boyce."""
    import numpy as np

    from studies.accuracy import metrics

    truth = metrics.ArrudaBoyceTruth()
    end = 3 + EXTRAPOLATION * (limit - 3)
    curves = {}
    for mode in metrics.MODES:
        stretch = np.linspace(1, metrics.largest_stretch(mode, end), CURVE_POINTS)
        curves[mode] = {
            "stretch": stretch,
            "limit": metrics.largest_stretch(mode, limit),
            "truth": metrics.nominal_stress(truth, mode, stretch),
            "stress": model.homogeneous(mode, stretch),
        }
    return {
        "inside": [asdict(a) for a in metrics.agreement(model, truth, limit)],
        "outside": [asdict(a) for a in metrics.agreement(model, truth, end, start=limit)],
        "curves": curves,
    }


def run_step(description: str | None, steps: Mapping[str, Callable[..., None]], kind: type[CaseSettings]) -> None:
    """Run one step of a study from the command line: its name, the folder, and keys; settings are those of the folder."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("step", choices=steps)
    parser.add_argument("folder", type=Path)
    parser.add_argument("key", nargs="*")
    arguments = parser.parse_args()
    steps[arguments.step](arguments.folder, kind.read(arguments.folder), *arguments.key)
