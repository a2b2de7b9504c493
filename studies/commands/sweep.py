"""`equigap sweep`: specimens x thicknesses x resolutions x noises x seeds, each combination calibrated on its own.

In: command-line options. Out: a folder with the forward solutions, which cases share, a small JSON for each case, a
table of all of them, a figure and a report; or, with --dry-run, the number of jobs that this takes. The steps are jobs
of the Snakemake workflow `sweep.smk`, here, on a cluster or in a container; a killed run resumes where it was.
"""

from __future__ import annotations

import argparse
import shlex
import shutil
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from studies.commands.options import add_output, nearest, output_folder
from studies.errors import OptionError
from studies.grid import cases, workflow
from studies.grid.sweep_case import PLANE, Settings, targets

QUICK = Settings(nodes=2500, seeds=(0, 1), starts=8, specimens=("cross",), thicknesses=(PLANE, "10"),
                 resolutions=("100", "25"), noises=("0", "0.1"))  # fmt: skip
SNAKEFILE = workflow.PROFILES.with_name("sweep.smk")
DESCRIPTION = """\
Calibrate every combination of specimen, thickness, resolution of the camera, noise and noise seed as if the specimen were
thin (plane stress), and report the bias of the stress. There is one forward solution for each specimen and thickness.
Give several values separated by commas. Lengths in mm, forces in N, stresses in MPa."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `equigap sweep`."""
    default = Settings()
    group = parser.add_argument_group("what is combined")
    for name, unit in (
        ("specimens", "of `equigap specimens`"), ("thicknesses", f"mm, {PLANE} or 0: plane stress"),
        ("resolutions", "percent of the nodes"), ("noises", "standard deviation of a displacement, mm; 0: clean data"),
    ):  # fmt: skip
        values = ",".join(getattr(default, name))
        group.add_argument(f"--{name}", metavar="X,X,...", help=f"{unit} (default: {values})")
    cases.add_arguments(parser, default, every_loss=False)
    parser.add_argument("--quick", action="store_true", help="12 cases: shows the path, proves nothing")
    group = parser.add_argument_group("where and how it runs")
    group.add_argument("--dry-run", action="store_true", help="only say how many jobs are missing; makes no file")
    workflow.add_arguments(group)
    group.add_argument(
        "--container", metavar="IMAGE", help="run every job by Apptainer in this image, such as equigap.sif: docker/README.md"
    )  # fmt: skip
    add_output(parser, "sweep")


def settings_from(arguments: argparse.Namespace) -> Settings:
    """Settings of the command line. Raises `OptionError`, `ConfigError`."""
    workflow.check_arguments(arguments)
    settings = cases.with_arguments(QUICK if arguments.quick else Settings(), arguments)
    readers = {"specimens": specimen, "thicknesses": thickness, "resolutions": resolution, "noises": noise}
    given: dict[str, Any] = {
        name: _values(f"--{name}", text, read)
        for name, read in readers.items()
        if (text := getattr(arguments, name)) is not None
    }
    settings = replace(settings, **given)
    return replace(settings, resolutions=tuple(sorted(settings.resolutions, key=float, reverse=True)))


def _values(option: str, text: str, read: Callable[[str], str]) -> tuple[str, ...]:
    """'10, 20' -> ('10', '20'). Raises `OptionError` for a value that cannot be, or that is there twice."""
    found = tuple(read(word.strip()) for word in text.split(","))
    twice = [value for value, count in Counter(found).items() if count > 1]
    if twice:
        raise OptionError(f"{option} {text}: {twice[0]} is there twice; write each value once")
    return found


def specimen(word: str) -> str:
    """Name of a specimen. Raises `OptionError`."""
    from studies.commands.simulate import EXTENT

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


def container_words(image: str | None, folder: Path) -> tuple[list[str], list[str]]:
    """Config of the snakefile and options of Snakemake that run every job in an image. Raises `OptionError`."""
    if image is None:
        return [], []
    if not shutil.which("apptainer") and not shutil.which("singularity"):
        raise OptionError(f"--container {image}: needs the program apptainer; install it, or leave --container out")
    if "://" not in image:
        if not Path(image).is_file():
            raise OptionError(f"--container {image}: no such file; docker/README.md says how the image is built")
        image = str(Path(image).resolve())
    bind = f"--bind {shlex.quote(str(folder.resolve()))}"
    return [f"container={image}"], ["--software-deployment-method", "apptainer", "--apptainer-args", bind]


def main(arguments: argparse.Namespace) -> int:
    """Run or resume the sweep, or say what is missing."""
    from studies.output import open_output_folder

    settings, folder = settings_from(arguments), output_folder(arguments, "sweep")
    config, words = container_words(arguments.container, folder)
    key = {"study": "sweep", **asdict(settings)}
    if arguments.dry_run:
        print(describe(settings, planned(arguments, folder, key, config, words)))
        return 0
    folder = open_output_folder(folder, arguments.overwrite, key)
    workflow.run_workflow(
        "sweep", SNAKEFILE, folder, targets(folder, settings), arguments.jobs, arguments.profile, config, words
    )
    print(f"report: {folder / 'report.html'}")
    return 0


def planned(
    arguments: argparse.Namespace, folder: Path, key: dict[str, object], config: Sequence[str], words: Sequence[str]
) -> dict[str, int]:
    """Jobs of each rule that are missing in `folder`, which is left as it is: one to be begun is planned elsewhere."""
    from studies.output import open_output_folder

    begun = folder.exists() and (not folder.is_dir() or any(folder.iterdir())) and not arguments.overwrite
    with TemporaryDirectory() as elsewhere:
        place = open_output_folder(folder if begun else Path(elsewhere), False, key)
        return workflow.plan(SNAKEFILE, place, arguments.jobs, arguments.profile, config, words)


def describe(settings: Settings, jobs: dict[str, int]) -> str:
    """What a dry run says."""
    parts = [f"{len(values)} {name}" for name, values in (
        ("specimens", settings.specimens), ("thicknesses", settings.thicknesses), ("resolutions", settings.resolutions),
        ("noises", settings.noises), ("seeds", settings.seeds))]  # fmt: skip
    lines = [f"{len(settings.cases)} cases: {' x '.join(parts)} (clean data know no seed)"]
    lines += [f"{rule:>10}  {count}" for rule, count in jobs.items()]
    return "\n".join([*lines, f"{'jobs to do':>10}  {sum(jobs.values())}"])
