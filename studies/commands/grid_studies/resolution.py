"""`equigap resolution`: how coarse may a camera be before a plane-stress calibration misleads?

In: command-line options. Out: a folder with every Experiment, model and case of the study, figures, table, report.
"""

from __future__ import annotations

from dataclasses import replace

from studies.commandline.option_types import OutputFolder, Overwrite
from studies.commandline.outcome import Outcome
from studies.grid.axes import Settings
from studies.grid.presets.resolution_study import RESOLUTION, losses_with
from studies.grid.study import Execution
from studies.grid.study_options import ExecutionOptions, LossOptions, Target, run_study


def resolution(
    *,
    quick: bool = False,
    options: LossOptions = LossOptions(),
    dry_run: bool = False,
    execution: ExecutionOptions = Execution(),
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> Outcome:
    """Study how the resolution of a camera and its noise limit what is identified.

    Args:
        quick: 2 meshes, 2 noise seeds: shows the path, proves nothing
        dry_run: only say how many jobs are missing; makes no file

    Raises:
        ConfigError: options that cannot be.
        WorkflowError: a job failed.
    """
    target = Target("resolution", quick, output, overwrite, dry_run)
    return run_study(RESOLUTION, settings_of(options, quick), execution, target)


def settings_of(options: LossOptions, quick: bool = False) -> Settings:
    """Settings of the study. Raises `ConfigError`."""
    settings = options.settings(RESOLUTION, quick)
    return replace(settings, losses=losses_with(settings.dependent_seeds))
