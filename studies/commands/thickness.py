"""`equigap thickness`: how thick may a specimen be before a plane-stress calibration misleads?

In: command-line options. Out: a folder with the 2D and 3D solutions, every Experiment, model and case of the study,
figures, tables, report; or, with --convergence, what the settings of the 3D model are worth.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import pairwise

from calibrate.errors import ConfigError
from studies.commands import study_options
from studies.commands.options import output_folder
from studies.grid.axes import PLANE, Settings
from studies.grid.convergence import run_convergence
from studies.grid.presets.thickness_study import FINE, THICKNESS

DESCRIPTION = """\
Pull crosses of several thicknesses in 3D, record their surfaces with a synthetic camera, calibrate them as if they were
thin (plane stress), and report where and how much this misleads. Lengths in mm, forces in N, stresses in MPa."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `equigap thickness`."""
    default = THICKNESS.default
    shown = ",".join(h for h in default.thicknesses if h != PLANE)
    parser.add_argument(
        "--fine", action="store_true", help="0.6 mm elements at the holes instead of 1.2 mm, much longer"
    )
    parser.add_argument(
        "--convergence", action="store_true", help="write the table of what each setting is worth, instead"
    )
    parser.add_argument("--thicknesses", metavar="H,H,...", help=f"in mm, rising (default: {shown})")
    parser.add_argument(
        "--displacement", type=float, metavar="MM", help=f"of each arm (default: {default.displacement:g})"
    )
    study_options.add_study_arguments(parser, THICKNESS, "2 thicknesses, 2 noise seeds")


def settings_from(arguments: argparse.Namespace) -> Settings:
    """Settings of the command line. Raises `ConfigError`."""
    settings = study_options.settings_from(arguments, THICKNESS)
    if arguments.quick and arguments.fine:
        raise ConfigError("--quick and --fine exclude each other; leave one out")
    if arguments.fine:
        settings = replace(settings, forward_size=FINE)
    if arguments.thicknesses is not None:
        settings = replace(settings, thicknesses=(PLANE, *thicknesses_from(arguments.thicknesses)))
    if arguments.displacement is not None:
        settings = replace(settings, displacement=arguments.displacement)
    if not 0 < settings.displacement < float("inf"):
        raise ConfigError(f"--displacement {settings.displacement:g}: give a positive number of mm")
    return settings


def thicknesses_from(text: str) -> tuple[str, ...]:
    """'10,20.0' -> ('10', '20'). Raises `ConfigError` unless they are positive, rising and told apart by their names."""
    try:
        found = tuple(float(word) for word in text.split(","))
    except ValueError as error:
        raise ConfigError(f"--thicknesses {text}: give numbers of mm separated by commas, e.g. 10,15,20,40") from error
    if not all(0 < h < float("inf") for h in found):
        raise ConfigError(f"--thicknesses {text}: every thickness must be a positive number of mm")
    named = [f"{h:g}" for h in found]
    if any(float(a) >= float(b) for a, b in pairwise(named)):
        right = ",".join(sorted(set(named), key=float))
        raise ConfigError(f"--thicknesses {text}: write each one once, rising, with at most six digits: {right}")
    return tuple(named)


def main(arguments: argparse.Namespace) -> int:
    """Run or resume the study and write its report."""
    settings = settings_from(arguments)
    if arguments.convergence:
        _check_convergence(arguments)
        folder = output_folder(arguments, "thickness-convergence")
        print(f"report: {run_convergence(folder, arguments.quick, arguments.overwrite)}")
        return 0
    return study_options.run_study(arguments, THICKNESS, settings, "thickness-fine" if arguments.fine else None)


def _check_convergence(arguments: argparse.Namespace) -> None:
    """Raise `ConfigError` for options that `--convergence` does not follow."""
    followed = {"quick", "convergence", "output", "overwrite", "jobs", "command"}
    default = argparse.ArgumentParser()
    add_arguments(default)
    for action in default._actions:
        given = getattr(arguments, action.dest, action.default)
        if action.dest not in followed and given != action.default:
            raise ConfigError(f"--convergence runs its own series; leave out {action.option_strings[-1]}")
