"""Blind trials side by side, each in a process of its own that ends with the command that started it."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from itertools import batched
from pathlib import Path

from studies.errors import StudyError
from studies.output.progress import Progress
from studies.trials.blind_case import Plan, run
from studies.trials.blind_plans import in_order_of_size

RENEWED = 12  # trials a worker after which all are renewed, with the memory that compiled code takes
BREAKDOWNS = 3  # of the pool of workers, after which the run is given up


def watch_parent(parent: int) -> None:
    """End this worker when the command that started it is gone, even if it was killed."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(2.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@dataclass
class Workers:
    """Processes that make trials side by side. trials: a folder. failures: {trial: error}, filled as they happen."""

    trials: Path
    jobs: int
    progress: Progress
    failures: dict[str, str] = field(default_factory=dict)

    def diagnose(self, plans: Sequence[Plan]) -> None:
        """Make trials; errors go to `failures`. Raises `BrokenExecutor` when a worker dies.

        Workers are renewed all at once: `max_tasks_per_child` stops for good in some versions of Python (gh-115634).
        """
        spawn = multiprocessing.get_context("spawn")
        for batch in batched(in_order_of_size(plans), self.jobs * RENEWED):
            with ProcessPoolExecutor(self.jobs, spawn, watch_parent, (os.getpid(),)) as pool:
                self._collect(pool, batch)

    def _collect(self, pool: ProcessPoolExecutor, batch: Sequence[Plan]) -> None:
        tasks = {pool.submit(run, plan, self.trials): plan for plan in batch}
        try:
            for task in as_completed(tasks):
                error = task.exception()
                if isinstance(error, (KeyboardInterrupt, MemoryError, BrokenExecutor)):
                    raise error
                if error is not None:
                    self.failures[tasks[task].name] = f"{type(error).__name__}: {error}"
                self.progress.update()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def diagnose_missing(trials: Path, jobs: int, total: int, missing: Callable[[], list[Plan]]) -> dict[str, str]:
    """Make every trial that is `missing` of `total`, again where workers die; returns the errors by trial.

    Raises `StudyError` when workers die again and again.
    """
    workers = Workers(trials, jobs, Progress("blind trials", total, "trial"))
    for _ in range(BREAKDOWNS):
        todo = missing()
        workers.progress.to(total - len(todo))
        try:
            workers.diagnose([plan for plan in todo if plan.name not in workers.failures])
        except BrokenExecutor:  # a worker was killed: for memory, or by hand
            continue
        workers.progress.close()
        return workers.failures
    raise StudyError(
        f"workers were killed {BREAKDOWNS} times, perhaps for want of memory; give --jobs 1, and the same "
        f"command again: {total - len(missing())} of {total} trials are kept"
    )
