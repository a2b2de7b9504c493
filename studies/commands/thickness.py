"""`equigap thickness`: how thick may a specimen be before a plane-stress calibration misleads?

In: command-line options. Out: a folder with the 2D and 3D solutions, every Experiment, model and case of the study,
figures, tables, report. The steps are jobs of the Snakemake workflow `thickness.smk`; a killed run resumes where it was.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path

from studies.commands.options import add_output, output_folder
from studies.grid import cases, workflow
from studies.grid.thickness_case import Settings, format_thickness, targets

QUICK = Settings(nodes=2500, seeds=(0, 1), starts=8, thicknesses=(10.0, 40.0))
FINE = 0.5
DESCRIPTION = """\
Pull crosses of several thicknesses in 3D, record their surfaces with a synthetic camera, calibrate them as if they were
thin (plane stress), and report where and how much this misleads. Lengths in mm, forces in N, stresses in MPa."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `equigap thickness`."""
    default = Settings()
    shown = ",".join(map(format_thickness, default.thicknesses))
    parser.add_argument(
        "--quick", action="store_true", help="2 thicknesses, 2 noise seeds: shows the path, proves nothing"
    )
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
    cases.add_arguments(parser, default)
    workflow.add_arguments(parser)
    parser.add_argument("--ranks", type=int, default=1, help="MPI ranks of each 3D solution (default: %(default)s)")
    add_output(parser, "thickness")


def settings_from(arguments: argparse.Namespace) -> Settings:
    """Settings of the command line. Raises `ConfigError`."""
    from calibrate.errors import ConfigError

    workflow.check_arguments(arguments)
    if arguments.ranks < 1:
        raise ConfigError(f"--ranks {arguments.ranks}: at least 1")
    if arguments.quick and arguments.fine:
        raise ConfigError("--quick and --fine exclude each other; leave one out")
    settings = cases.with_arguments(QUICK if arguments.quick else Settings(), arguments)
    if arguments.fine:
        settings = replace(settings, forward_size=FINE)
    if arguments.thicknesses is not None:
        settings = replace(settings, thicknesses=thicknesses_from(arguments.thicknesses))
    if arguments.displacement is not None:
        settings = replace(settings, displacement=arguments.displacement)
    if not 0 < settings.displacement < float("inf"):
        raise ConfigError(f"--displacement {settings.displacement:g}: give a positive number of mm")
    return settings


def thicknesses_from(text: str) -> tuple[float, ...]:
    """'10,20' -> (10.0, 20.0). Raises `ConfigError` unless they are positive, rising and told apart by their names."""
    from calibrate.errors import ConfigError

    try:
        found = tuple(float(word) for word in text.split(","))
    except ValueError as error:
        raise ConfigError(f"--thicknesses {text}: give numbers of mm separated by commas, e.g. 10,15,20,40") from error
    if not all(0 < h < float("inf") for h in found):
        raise ConfigError(f"--thicknesses {text}: every thickness must be a positive number of mm")
    named = [float(format_thickness(h)) for h in found]
    if any(a >= b for a, b in pairwise(named)):
        right = ",".join(map(format_thickness, sorted(set(named))))
        raise ConfigError(f"--thicknesses {text}: write each one once, rising, with at most six digits: {right}")
    return tuple(named)


def main(arguments: argparse.Namespace) -> int:
    """Run or resume the study and write its report."""
    settings = settings_from(arguments)
    if arguments.convergence:
        _check_convergence(arguments)
        from studies.grid import thickness_convergence

        return int(thickness_convergence.main(arguments))
    from studies.output import open_output_folder

    name = "thickness-fine" if arguments.fine else "thickness"
    folder = open_output_folder(
        output_folder(arguments, name), arguments.overwrite, {"study": "thickness", **asdict(settings)}
    )
    run_workflow(folder, settings, arguments.jobs, arguments.profile, arguments.ranks)
    from studies.grid import thickness_report

    print(f"report: {thickness_report.write(folder, settings)}")
    return 0


def _check_convergence(arguments: argparse.Namespace) -> None:
    """Raise `ConfigError` for options that `--convergence` does not follow."""
    from calibrate.errors import ConfigError

    followed = {"quick", "convergence", "output", "overwrite", "jobs", "command"}
    default = argparse.ArgumentParser()
    add_arguments(default)
    for action in default._actions:
        given = getattr(arguments, action.dest, action.default)
        if action.dest not in followed and given != action.default:
            raise ConfigError(f"--convergence runs its own series; leave out {action.option_strings[-1]}")


def run_workflow(
    folder: Path, settings: Settings, jobs: int | None, profile: Path | None = None, ranks: int = 1
) -> None:
    """Run every missing step with Snakemake. Raises `WorkflowError` naming the log."""
    snakefile = workflow.PROFILES.with_name("thickness.smk")
    wanted = targets(folder, settings)
    workflow.run_workflow("thickness study", snakefile, folder, wanted, jobs, profile, [f"ranks={ranks}"])
