"""`equigap resolution`: how coarse may a camera be before a plane-stress calibration misleads?

In: command-line options. Out: a folder with every Experiment, model and case of the study, figures, table, report.
The cases are independent jobs of the Snakemake workflow `resolution.smk`; a killed run resumes where it was.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import threading
from dataclasses import asdict
from pathlib import Path

from studies.resolution_case import Settings, format_level

QUICK = Settings(nodes=2500, levels=(100.0, 25.0), seeds=(0, 1), dependent_seeds=0, starts=8, forward_size=1.0)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `equigap resolution`."""
    default = Settings()
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("results/resolution"), help="folder (default: %(default)s)"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier run with other settings")
    parser.add_argument("--quick", action="store_true", help="2 meshes, 2 noise seeds: shows the path, proves nothing")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="cases at a time (default: %(default)s)")
    parser.add_argument("--seeds", type=int, help=f"number of noise seeds (default: {len(default.seeds)})")
    parser.add_argument("--nodes", type=int, help=f"nodes of the finest triangulation (default: {default.nodes})")
    parser.add_argument("--inputs", choices=("I1", "I2", "I1I2"), help="invariants of the network (default: I1)")
    parser.add_argument("--layers", help="neurons of each layer, e.g. 4,4 (default)")
    parser.add_argument(
        "--dependent-seeds",
        type=int,
        help="noise seeds that are also fitted with the paper's loss in "
        f"its dependent scaling by SLSQP on the full data (default: {default.dependent_seeds})",
    )
    parser.add_argument("--normalisation", choices=("unit-variance", "unit-maximum"), help="of the random field")


def settings_from(arguments: argparse.Namespace) -> Settings:
    """Settings of the command line. Raises `ConfigError`."""
    from dataclasses import replace

    from calibrate.errors import ConfigError

    settings = QUICK if arguments.quick else Settings()
    given = {name: getattr(arguments, name, None) for name in ("nodes", "inputs", "dependent_seeds", "normalisation")}
    settings = replace(settings, **{name: value for name, value in given.items() if value is not None})
    if arguments.seeds is not None:
        settings = replace(settings, seeds=tuple(range(arguments.seeds)))
    if arguments.layers is not None:
        try:
            settings = replace(settings, layers=tuple(int(n) for n in arguments.layers.split(",")))
        except ValueError as error:
            raise ConfigError(
                f"--layers {arguments.layers}: give whole numbers separated by commas, e.g. 4,4"
            ) from error
    if settings.nodes < 800 or not settings.seeds or min(settings.layers) < 1 or settings.dependent_seeds < 0:
        raise ConfigError("at least 800 nodes, one seed and one neuron a layer are needed")
    if arguments.jobs < 1:
        raise ConfigError(f"--jobs {arguments.jobs}: at least 1")
    return settings


def main(arguments: argparse.Namespace) -> int:
    """Run or resume the study and write its report."""
    from studies import resolution_report
    from studies.output import open_output_folder

    settings = settings_from(arguments)
    folder = open_output_folder(arguments.output, arguments.overwrite, {"study": "resolution", **asdict(settings)})
    run_workflow(folder, settings, arguments.jobs)
    report = resolution_report.write(folder, settings)
    print(f"report: {report}")
    return 0


def run_workflow(folder: Path, settings: Settings, jobs: int) -> None:
    """Run every missing case with Snakemake, showing progress. Raises `WorkflowError` naming the log."""
    from studies.errors import WorkflowError
    from studies.output import Progress

    folder = folder.resolve()
    cases = [folder / "cases" / f"{format_level(level)}_{seed}.json"
             for level in settings.levels for seed in settings.noise_seeds]  # fmt: skip
    if all(case.exists() for case in cases):
        return
    # files are written atomically, so one that exists is complete, whatever Snakemake thinks of a killed job
    work = folder / "workflow"
    work.mkdir(exist_ok=True)
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(Path(__file__).with_name("resolution.smk")),
               "--cores", str(jobs), "--directory", str(work), "--ignore-incomplete", "--rerun-triggers", "mtime",
               "--nolock", "--config", f"folder={folder}"]  # fmt: skip
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "TQDM_DISABLE": "1",
                   "JAX_COMPILATION_CACHE_DIR": str(work / "jax"), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.5",
                   "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false"}  # fmt: skip
    log = folder / "workflow.log"
    done = threading.Event()
    with log.open("a") as file, Progress("resolution study", len(cases), "cases") as progress:
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, env=environment)
        try:
            while process.poll() is None:
                progress.to(sum(case.exists() for case in cases))
                done.wait(1.0)
        except BaseException:
            process.terminate()
            process.wait(30)
            raise
        progress.to(sum(case.exists() for case in cases))
    if process.returncode:
        raise WorkflowError(
            f"a job of the study failed; the reason is in {log}. Finished cases are kept: "
            "mend it and run the same command again"
        )
