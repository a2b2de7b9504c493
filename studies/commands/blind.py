"""`equigap blind`: does the diagnosis find what is hidden, and nothing where nothing is?

In: numbers of trials. Out: a folder with every trial, its diagnosis and label, tables, confusion matrix, report. Trials are
independent; a killed run goes on with those that are not there yet, on another machine with ``--known trials.json`` of the first.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import threading
import time
from collections.abc import Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, as_completed
from itertools import batched, count
from pathlib import Path
from typing import Any

from studies.commands.options import add_output, output_folder, seed
from studies.errors import StudyError
from studies.output.folder import open_output_folder
from studies.output.progress import Progress
from studies.trials.blind_case import Plan, run

DESCRIPTION = """\
Blind trials of `equigap discover`: a seed draws specimen, base material, one hidden effect or none, amplitude and noise;
the diagnosis sees the Experiment alone. Prints the confusion matrix and writes every trial."""
PAIRS = (
    ("second invariant", "force offset"),
    ("viscoelasticity", "stiffness gradient"),
    ("one fibre family", "unmeasured strip"),
    ("compressibility", "image rotation"),
    ("Mullins softening", "second invariant"),
)

ABSENT = 3  # of so many trials of an effect, one is diagnosed once more without the effect in the catalogue
WINDOW = 72  # trials that are put in an order of their own
RENEWED = 12  # trials a worker after which all are renewed, with the memory that compiled code takes
BREAKDOWNS = 3  # of the pool of workers, after which the run is given up


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `equigap blind`."""
    parser.add_argument("--trials", type=int, default=20, help="for each effect (default: %(default)s)")
    parser.add_argument("--nulls", type=int, default=100, help="without an effect (default: %(default)s)")
    parser.add_argument("--pairs", type=int, default=20, help="with two effects (default: %(default)s)")
    parser.add_argument("--only", metavar="EFFECT,EFFECT,...", help="effects to hide (default: all that can be found)")
    parser.add_argument("--seed", type=seed, default=20000, help="of the first trial (default: %(default)s)")
    parser.add_argument("--quick", action="store_true", help="one trial an effect, two without: shows the path")
    parser.add_argument("--jobs", type=int, help="trials side by side (default: number of cores)")
    parser.add_argument(
        "--known", type=Path, metavar="trials.json", help="trials of an earlier run that are not made again"
    )
    parser.add_argument("--report", action="store_true", help="only write the report, of the trials that are there")
    add_output(parser, "blind")


def plans(arguments: argparse.Namespace) -> list[Plan]:
    """All trials, mixed so that a run that is stopped has some of each. Raises `ConfigError`."""
    from calibrate.errors import ConfigError
    from studies.trials.blind_effects import FREQUENT, LATER

    effects = list(FREQUENT)
    if arguments.only is not None:
        effects = [name.strip() for name in arguments.only.split(",") if name.strip()]
        unknown = [name for name in effects if name not in FREQUENT]
        if unknown:
            raise ConfigError(f"--only {unknown[0]}: choose from {', '.join(FREQUENT)}")
    n, nulls, pairs = (1, 2, 1) if arguments.quick else (arguments.trials, arguments.nulls, arguments.pairs)
    if min(n, nulls, pairs) < 0 or n + nulls + pairs == 0:
        raise ConfigError("--trials, --nulls and --pairs count trials; give numbers that are not negative")
    seeds = count(arguments.seed)  # every trial its own: effects of one seed would share material, specimen and noise

    def hiding(names: Sequence[str]) -> list[Plan]:
        return [Plan(next(seeds), (name,), k % ABSENT == 0) for k in range(n) for name in names]

    single = hiding([name for name in effects if name not in LATER])
    none = [Plan(next(seeds)) for _ in range(nulls)]
    both = [Plan(next(seeds), PAIRS[i % len(PAIRS)]) for i in range(pairs)]
    later = hiding([name for name in effects if name in LATER])
    ranked = [(k / max(len(group), 1), plan) for group in (single, none, both, later) for k, plan in enumerate(group)]
    return [plan for _, plan in sorted(ranked, key=lambda pair: pair[0])]


def in_order_of_size(todo: Sequence[Plan]) -> list[Plan]:
    """Trials of one specimen and number of increments in a row, within a `WINDOW`: they share compiled code."""
    from studies.trials.blind_data import draw

    def size(plan: Plan) -> tuple[str, int]:
        trial = draw(plan.seed, *(plan.effects or (None,)))
        return trial.specimen, len(trial.factors)

    return [plan for window in batched(todo, WINDOW) for plan in sorted(window, key=size)]


def watch_parent(parent: int) -> None:
    """End this worker when the command that started it is gone, even if it was killed."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(2.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def diagnose_all(
    missing: list[Plan], trials: Path, cache: Path, jobs: int, failures: dict[str, str], progress: Progress
) -> None:
    """Run trials side by side; errors go to `failures`. Raises `BrokenExecutor` when a worker dies.

    Workers are renewed all at once: `max_tasks_per_child` stops for good in some versions of Python (gh-115634).
    """
    spawn = multiprocessing.get_context("spawn")
    for batch in batched(missing, jobs * RENEWED):
        _diagnose_batch(
            batch, trials, cache, ProcessPoolExecutor(jobs, spawn, watch_parent, (os.getpid(),)), failures, progress
        )


def _diagnose_batch(
    batch: Sequence[Plan],
    trials: Path,
    cache: Path,
    pool: ProcessPoolExecutor,
    failures: dict[str, str],
    progress: Progress,
) -> None:
    with pool:
        tasks = {pool.submit(run, plan, trials, cache): plan for plan in batch}
        try:
            for task in as_completed(tasks):
                error = task.exception()
                if isinstance(error, (KeyboardInterrupt, MemoryError, BrokenExecutor)):
                    raise error
                if error is not None:
                    failures[tasks[task].name] = f"{type(error).__name__}: {error}"
                progress.update()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def read_known(path: Path | None, todo: Sequence[Plan]) -> dict[str, dict[str, Any]]:
    """Judged trials of an earlier run by name, those of this plan. Raises `StudyError`."""
    if path is None:
        return {}
    try:
        known = {one["trial"]: one for one in json.loads(path.read_text())}
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise StudyError(f"--known {path}: give the trials.json of a blind run ({error})") from None
    found = {plan.name: known[plan.name] for plan in todo if plan.name in known}
    if not found:
        raise StudyError(f"--known {path}: none of its trials is one of this run; give the same --seed and numbers")
    return found


def main(arguments: argparse.Namespace) -> int:
    """Run or resume the trials and write the report.

    Raises `StudyError` where --report finds no trial, workers are killed again and again, more than a tenth of the
    trials fail, or --known is no file of this run.
    """
    from studies.trials.blind_report import write_report

    todo = plans(arguments)
    settings = {"trials": arguments.trials, "nulls": arguments.nulls, "pairs": arguments.pairs,
                "only": arguments.only, "seed": arguments.seed, "quick": arguments.quick}  # fmt: skip
    folder = open_output_folder(output_folder(arguments, "blind"), arguments.overwrite, {"study": "blind", **settings})
    trials, cache = folder / "trials", folder / "cache"
    trials.mkdir(parents=True, exist_ok=True)
    jobs = arguments.jobs or os.cpu_count() or 1
    known = read_known(arguments.known, todo)

    def still_missing() -> list[Plan]:
        return [p for p in todo if p.name not in known and not (trials / p.name / "diagnosis.json").exists()]

    missing = still_missing()
    failures: dict[str, str] = {}
    if arguments.report:
        if len(missing) == len(todo):
            raise StudyError(f"{folder}: no trial is there yet; run the same command without --report first")
        print(f"{len(todo) - len(missing)} of {len(todo)} trials")
        print(write_report(folder, [trials / plan.name for plan in todo], failures, known))
        return 0
    progress = Progress("blind trials", len(todo), "trial")
    progress.to(len(todo) - len(missing))
    for breakdown in range(BREAKDOWNS):
        try:
            diagnose_all(
                in_order_of_size([plan for plan in missing if plan.name not in failures]),
                trials,
                cache,
                jobs,
                failures,
                progress,
            )
            break
        except BrokenExecutor:  # a worker was killed: for memory, or by hand
            missing = still_missing()
            if breakdown == BREAKDOWNS - 1:
                raise StudyError(
                    f"workers were killed {BREAKDOWNS} times, perhaps for want of memory; give --jobs 1, and the same "
                    f"command again: {len(todo) - len(missing)} of {len(todo)} trials are kept"
                ) from None
            progress.to(len(todo) - len(missing))
    progress.close()
    print(write_report(folder, [trials / p.name for p in todo if p.name not in failures], failures, known))
    if len(failures) > 0.1 * len(todo):
        raise StudyError(f"{len(failures)} of {len(todo)} trials failed, first: {next(iter(failures.items()))}")
    return 0
