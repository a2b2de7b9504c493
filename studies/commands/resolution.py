"""`equigap resolution`: how coarse may a camera be before a plane-stress calibration misleads?

In: command-line options. Out: a folder with every Experiment, model and case of the study, figures, table, report.
The cases are independent jobs of the Snakemake workflow `resolution.smk`; a killed run resumes where it was.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path

from studies.grid import cases, workflow
from studies.grid.resolution_case import Settings, format_level

QUICK = Settings(nodes=2500, levels=(100.0, 25.0), seeds=(0, 1), dependent_seeds=0, starts=8, forward_size=1.0)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `equigap resolution`."""
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("results/resolution"), help="folder (default: %(default)s)"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier run with other settings")
    parser.add_argument("--quick", action="store_true", help="2 meshes, 2 noise seeds: shows the path, proves nothing")
    cases.add_arguments(parser, Settings())
    workflow.add_arguments(parser)


def settings_from(arguments: argparse.Namespace) -> Settings:
    """Settings of the command line. Raises `ConfigError`."""
    workflow.check_arguments(arguments)
    return cases.with_arguments(QUICK if arguments.quick else Settings(), arguments)


def main(arguments: argparse.Namespace) -> int:
    """Run or resume the study and write its report."""
    from studies.grid import resolution_report
    from studies.output import open_output_folder

    settings = settings_from(arguments)
    folder = open_output_folder(arguments.output, arguments.overwrite, {"study": "resolution", **asdict(settings)})
    run_workflow(folder, settings, arguments.jobs, arguments.profile)
    report = resolution_report.write(folder, settings)
    print(f"report: {report}")
    return 0


def run_workflow(folder: Path, settings: Settings, jobs: int | None, profile: Path | None = None) -> None:
    """Run every missing case with Snakemake. Raises `WorkflowError` naming the log."""
    targets = [folder / "cases" / f"{format_level(level)}_{seed}.json"
               for level in settings.levels for seed in settings.noise_seeds]  # fmt: skip
    workflow.run_workflow(
        "resolution study", workflow.PROFILES.with_name("resolution.smk"), folder, targets, jobs, profile
    )
