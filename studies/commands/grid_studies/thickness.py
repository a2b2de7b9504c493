"""`equigap thickness`: how thick may a specimen be before a plane-stress calibration misleads?

In: command-line options. Out: a folder with the 2D and 3D solutions, every Experiment, model and case of the study,
figures, tables, report; or, with --convergence, what the settings of the 3D model are worth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from math import inf
from typing import Annotated, Any

from cyclopts import Parameter

from calibrate.errors import ConfigError
from studies.commandline.option_types import Names, OutputFolder, Overwrite
from studies.commandline.outcome import Outcome
from studies.grid.axes import PLANE, Settings
from studies.grid.convergence import run_convergence
from studies.grid.presets.thickness_study import FINE, THICKNESS
from studies.grid.study import Execution
from studies.grid.study_options import ExecutionOptions, LossOptions, StudyReport, Target, run_study

USUAL = ",".join(h for h in THICKNESS.default.thicknesses if h != PLANE)


@Parameter(name="*", group="Specimens")
@dataclass(frozen=True)
class Pull:
    """What is pulled, and on which mesh."""

    thicknesses: Annotated[Names, Parameter(help=f"in mm, rising, with commas between (default: {USUAL})")] = ()
    displacement: float | None = None
    """of each arm, mm (default: 60)"""
    fine: bool = False
    """0.6 mm elements at the holes instead of 1.2 mm, much longer"""


def thickness(
    *,
    quick: bool = False,
    convergence: bool = False,
    pull: Pull = Pull(),
    options: LossOptions = LossOptions(),
    dry_run: bool = False,
    execution: ExecutionOptions = Execution(),
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> Outcome:
    """Pull crosses of several thicknesses in 3D and calibrate them as if they were thin.

    Their surfaces are recorded with a synthetic camera and calibrated in plane stress; the report says where and how much this
    misleads. Lengths in mm, forces in N, stresses in MPa.

    Args:
        quick: 2 thicknesses, 2 noise seeds: shows the path, proves nothing
        convergence: write the table of what each setting is worth, instead
        dry_run: only say how many jobs are missing; makes no file

    Raises:
        ConfigError: options that cannot be.
        WorkflowError: a job failed.
    """
    settings = settings_of(options, pull, quick)
    if convergence:
        _refuse_given(pull, options, replace(execution, jobs=None))
        if dry_run:
            raise ConfigError("--convergence runs its own series; leave out --dry-run")
        target = Target("thickness-convergence", quick, output)
        return StudyReport(run_convergence(target.folder, quick, overwrite))
    name = "thickness-fine" if pull.fine else "thickness"
    return run_study(THICKNESS, settings, execution, Target(name, quick, output, overwrite, dry_run))


def settings_of(options: LossOptions, pull: Pull = Pull(), quick: bool = False) -> Settings:
    """Settings of the study. Raises `ConfigError`."""
    settings = options.settings(THICKNESS, quick)
    if quick and pull.fine:
        raise ConfigError("--quick and --fine exclude each other; leave one out")
    if pull.fine:
        settings = replace(settings, forward_size=FINE)
    if pull.thicknesses:
        settings = replace(settings, thicknesses=(PLANE, *thicknesses_from(pull.thicknesses)))
    if pull.displacement is not None:
        settings = replace(settings, displacement=pull.displacement)
    if not 0 < settings.displacement < inf:
        raise ConfigError(f"--displacement {settings.displacement:g}: give a positive number of mm")
    return settings


def thicknesses_from(words: Sequence[str]) -> tuple[str, ...]:
    """('10', '20.0') -> ('10', '20'). Raises `ConfigError` unless they are positive, rising and told apart by their names."""
    option = f"--thicknesses {','.join(words)}"
    try:
        found = tuple(float(word) for word in words)
    except ValueError as error:
        raise ConfigError(f"{option}: give numbers of mm separated by commas, e.g. 10,15,20,40") from error
    if not all(0 < h < inf for h in found):
        raise ConfigError(f"{option}: every thickness must be a positive number of mm")
    named = [f"{h:g}" for h in found]
    if any(float(a) >= float(b) for a, b in pairwise(named)):
        right = ",".join(sorted(set(named), key=float))
        raise ConfigError(f"{option}: write each one once, rising, with at most six digits: {right}")
    return tuple(named)


def _refuse_given(*parts: Any) -> None:
    """Raise `ConfigError` for an option that `--convergence` does not follow."""
    for part in parts:
        for field in fields(part):
            if getattr(part, field.name) != field.default:
                option = field.name.replace("_", "-")
                raise ConfigError(f"--convergence runs its own series; leave out --{option}")
