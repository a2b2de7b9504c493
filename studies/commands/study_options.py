"""Options that resolution, thickness and sweep share: the camera and the calibration, where and how jobs run, the output."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from math import isfinite
from pathlib import Path

from calibrate.errors import ConfigError
from studies.commands.options import add_output, nearest, output_folder
from studies.errors import OptionError
from studies.grid import study, workflow
from studies.grid.axes import EXTENT, LEAST_NODES, PLANE, Settings
from studies.grid.study import Execution, Preset


def add_study_arguments(parser: argparse.ArgumentParser, preset: Preset, quick: str, every_loss: bool = True) -> None:
    """Options of a preset. quick: what --quick leaves. every_loss: whether the study fits the paper's losses."""
    default = preset.default
    parser.add_argument("--quick", action="store_true", help=f"{quick}: shows the path, proves nothing")
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
    add_execution(parser)
    add_output(parser, preset.name)


def add_execution(parser: argparse.ArgumentParser) -> None:
    """Options that say where and how jobs run; they do not change results."""
    group = parser.add_argument_group("where and how it runs")
    group.add_argument("--dry-run", action="store_true", help="only say how many jobs are missing; makes no file")
    group.add_argument("--jobs", type=int, help="jobs at a time (default: number of cores, or what the profile says)")
    group.add_argument(
        "--profile", type=Path, metavar="FOLDER",
        help="Snakemake profile that submits the jobs, e.g. to SLURM: docs/cluster.md",
    )  # fmt: skip
    group.add_argument("--ranks", type=int, default=1, help="MPI ranks of each 3D solution (default: %(default)s)")
    group.add_argument(
        "--container", metavar="IMAGE", help="run every job by Apptainer in this image, such as equigap.sif: docker/README.md"
    )  # fmt: skip


def settings_from(arguments: argparse.Namespace, preset: Preset) -> Settings:
    """Settings of the shared options. Raises `ConfigError`."""
    workflow.check(arguments.jobs, arguments.profile)
    if arguments.ranks < 1:
        raise ConfigError(f"--ranks {arguments.ranks}: at least 1")
    settings = preset.quick if arguments.quick else preset.default
    given = {name: getattr(arguments, name, None) for name in ("nodes", "inputs", "dependent_seeds", "normalisation")}
    settings = replace(settings, **{name: value for name, value in given.items() if value is not None})
    if arguments.seeds is not None:
        settings = replace(settings, seeds=tuple(range(arguments.seeds)))
    if arguments.layers is not None:
        settings = replace(settings, layers=_layers(arguments.layers))
    few = settings.nodes < LEAST_NODES or not settings.seeds
    if few or min(settings.layers) < 1 or settings.dependent_seeds < 0:
        raise ConfigError(f"at least {LEAST_NODES} nodes, one seed and one neuron a layer are needed")
    return settings


def _layers(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(n) for n in text.split(","))
    except ValueError as error:
        raise ConfigError(f"--layers {text}: give whole numbers separated by commas, e.g. 4,4") from error


def run_study(arguments: argparse.Namespace, preset: Preset, settings: Settings, name: str | None = None) -> int:
    """Run or resume a study and name its report, or say how many jobs are missing. name: of the folder in results."""
    folder = output_folder(arguments, name or preset.name)
    execution = Execution(arguments.jobs, arguments.profile, arguments.ranks, arguments.container)
    if arguments.dry_run:
        print(describe(settings, study.plan(settings, folder, execution, arguments.overwrite)))
    else:
        print(f"report: {study.run(preset, settings, folder, execution, arguments.overwrite)}")
    return 0


def describe(settings: Settings, jobs: dict[str, int]) -> str:
    """What a dry run says."""
    names = ("specimens", "thicknesses", "resolutions", "noises", "seeds")
    axes = " x ".join(f"{len(getattr(settings, name))} {name}" for name in names)
    lines = [f"{len(settings.cases)} cases: {axes} (clean data have no seed)"]
    lines += [f"{rule:>10}  {count}" for rule, count in jobs.items()]
    return "\n".join([*lines, f"{'jobs to do':>10}  {sum(jobs.values())}"])


def axis(option: str, text: str, read: Callable[[str], str]) -> tuple[str, ...]:
    """'10, 20' -> ('10', '20'). Raises `OptionError` for a value that cannot be, or that is there twice."""
    found = tuple(read(word.strip()) for word in text.split(","))
    twice = [value for value, count in Counter(found).items() if count > 1]
    if twice:
        raise OptionError(f"{option} {text}: {twice[0]} is there twice; write each value once")
    return found


def specimen(word: str) -> str:
    """Name of a specimen. Raises `OptionError`."""
    if word not in EXTENT:
        raise OptionError(f"specimen '{word}' is unknown{nearest(word, EXTENT)}; choose from {', '.join(EXTENT)}")
    return word


def thickness(word: str) -> str:
    """A thickness as in file names. Raises `OptionError`."""
    if word.upper() == PLANE:
        return PLANE
    value = _number(word)
    if value is None or value < 0:
        raise OptionError(f"thickness '{word}': give a number of mm above 0, or {PLANE} for plane stress")
    return f"{value:g}" if value > 0 else PLANE


def resolution(word: str) -> str:
    """A share of the nodes as in file names. Raises `OptionError`."""
    value = _number(word)
    if value is None or not 0 < value <= 100:
        raise OptionError(f"resolution '{word}': give a percentage of the nodes, above 0 and at most 100")
    return f"{value:g}"


def noise(word: str) -> str:
    """A standard deviation as in file names. Raises `OptionError`."""
    value = _number(word)
    if value is None or value < 0:
        raise OptionError(f"noise '{word}': give a standard deviation in mm, 0 or more")
    return f"{value:g}" if value > 0 else "0"


def _number(word: str) -> float | None:
    """A finite number, or None."""
    try:
        value = float(word)
    except ValueError:
        return None
    return value if isfinite(value) else None
