"""`equigap resolution`: how coarse may a camera be before a plane-stress calibration misleads?

In: command-line options. Out: a folder with every Experiment, model and case of the study, figures, table, report.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

from studies.commands import study_options
from studies.grid.axes import Settings
from studies.grid.presets.resolution_study import RESOLUTION, losses_with


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `equigap resolution`."""
    study_options.add_study_arguments(parser, RESOLUTION, "2 meshes, 2 noise seeds")


def settings_from(arguments: argparse.Namespace) -> Settings:
    """Settings of the command line. Raises `ConfigError`."""
    settings = study_options.settings_from(arguments, RESOLUTION)
    return replace(settings, losses=losses_with(settings.dependent_seeds))


def main(arguments: argparse.Namespace) -> int:
    """Run or resume the study and write its report."""
    return study_options.run_study(arguments, RESOLUTION, settings_from(arguments))
