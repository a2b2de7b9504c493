"""`equigap sweep`: specimens x thicknesses x resolutions x noises x seeds, each combination calibrated on its own.

In: command-line options. Out: a folder with the forward solutions, which cases share, a small JSON for each case, a
table of all of them, a figure and a report; or, with --dry-run, the number of jobs that this takes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import isfinite
from typing import Annotated, Any

from cyclopts import Parameter

from studies.commandline.option_types import Names, OutputFolder, Overwrite, nearest
from studies.commandline.outcome import Outcome
from studies.errors import OptionError
from studies.grid.axes import EXTENT, PLANE, Settings
from studies.grid.presets.sweep_study import SWEEP
from studies.grid.study import Execution
from studies.grid.study_options import ExecutionOptions, StudyOptions, Target, run_study


def _axis(name: str, unit: str) -> Parameter:
    return Parameter(help=f"{unit} (default: {','.join(getattr(SWEEP.default, name))})")


@Parameter(name="*", group="What is combined")
@dataclass(frozen=True)
class Axes:
    """Values that are combined; () stands for the preset's own."""

    specimens: Annotated[Names, _axis("specimens", "of `equigap specimens`")] = ()
    thicknesses: Annotated[Names, _axis("thicknesses", f"mm, {PLANE} or 0: plane stress")] = ()
    resolutions: Annotated[Names, _axis("resolutions", "percent of the nodes")] = ()
    noises: Annotated[Names, _axis("noises", "standard deviation of a displacement, mm; 0: clean data")] = ()


def sweep(
    *,
    quick: bool = False,
    axes: Axes = Axes(),
    options: StudyOptions = StudyOptions(),
    dry_run: bool = False,
    execution: ExecutionOptions = Execution(),
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> Outcome:
    """Calibrate every combination of specimen, thickness, resolution of the camera, noise and noise seed.

    Each is calibrated as if the specimen were thin (plane stress); the report shows the bias of the stress. There is one forward
    solution for each specimen and thickness. Give several values separated by commas. Lengths in mm, forces in N, stresses in MPa.

    Args:
        quick: 12 cases: shows the path, proves nothing
        dry_run: only say how many jobs are missing; makes no file

    Raises:
        OptionError: values that cannot be combined.
        ConfigError: options that cannot be.
        WorkflowError: a job failed.
    """
    settings = settings_of(options, axes, quick)
    return run_study(SWEEP, settings, execution, Target("sweep", quick, output, overwrite, dry_run))


def settings_of(options: StudyOptions, axes: Axes = Axes(), quick: bool = False) -> Settings:
    """Settings of the study. Raises `OptionError`, `ConfigError`."""
    settings = options.settings(SWEEP, quick)
    given: dict[str, Any] = {}
    for name, read in READERS.items():
        words = getattr(axes, name)
        if words:
            given[name] = values(name, words, read)
    settings = replace(settings, **given)
    return replace(settings, resolutions=tuple(sorted(settings.resolutions, key=float, reverse=True)))


def values(name: str, words: tuple[str, ...], read: Callable[[str], str]) -> tuple[str, ...]:
    """Each word read. Raises `OptionError` for a value that cannot be, or that is there twice."""
    found = tuple(read(word) for word in words)
    twice = [value for value, count in Counter(found).items() if count > 1]
    if twice:
        raise OptionError(f"--{name} {','.join(words)}: {twice[0]} is there twice; write each value once")
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


READERS: dict[str, Callable[[str], str]] = {
    "specimens": specimen, "thicknesses": thickness, "resolutions": resolution, "noises": noise,
}  # fmt: skip
