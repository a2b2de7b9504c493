"""`equigap sweep`: specimens x thicknesses x resolutions x noises x seeds, each combination calibrated on its own.

In: command-line options. Out: a folder with the forward solutions, which cases share, a small JSON for each case, a
table of all of them, a figure and a report; or, with --dry-run, the number of jobs that this takes.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

from studies.commands import study_options
from studies.grid.axes import PLANE, Settings
from studies.grid.presets.sweep_study import SWEEP

DESCRIPTION = """\
Calibrate every combination of specimen, thickness, resolution of the camera, noise and noise seed as if the specimen were
thin (plane stress), and report the bias of the stress. There is one forward solution for each specimen and thickness.
Give several values separated by commas. Lengths in mm, forces in N, stresses in MPa."""
AXES = {
    "specimens": ("of `equigap specimens`", study_options.specimen),
    "thicknesses": (f"mm, {PLANE} or 0: plane stress", study_options.thickness),
    "resolutions": ("percent of the nodes", study_options.resolution),
    "noises": ("standard deviation of a displacement, mm; 0: clean data", study_options.noise),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `equigap sweep`."""
    group = parser.add_argument_group("what is combined")
    for name, (unit, _) in AXES.items():
        values = ",".join(getattr(SWEEP.default, name))
        group.add_argument(f"--{name}", metavar="X,X,...", help=f"{unit} (default: {values})")
    study_options.add_study_arguments(parser, SWEEP, "12 cases", every_loss=False)


def settings_from(arguments: argparse.Namespace) -> Settings:
    """Settings of the command line. Raises `OptionError`, `ConfigError`."""
    settings = study_options.settings_from(arguments, SWEEP)
    given: dict[str, Any] = {}
    for name, (_, read) in AXES.items():
        text = getattr(arguments, name)
        if text is not None:
            given[name] = study_options.axis(f"--{name}", text, read)
    settings = replace(settings, **given)
    return replace(settings, resolutions=tuple(sorted(settings.resolutions, key=float, reverse=True)))


def main(arguments: argparse.Namespace) -> int:
    """Run or resume the sweep, or say what is missing."""
    return study_options.run_study(arguments, SWEEP, settings_from(arguments))
