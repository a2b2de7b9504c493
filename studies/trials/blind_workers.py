"""Trials side by side, each in a process of its own that ends with the command that started it."""

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
from typing import Protocol

from studies.errors import StudyError
from studies.output.progress import Progress

RENEWED = 12  # trials a worker after which all are renewed, with the memory that compiled code takes
BREAKDOWNS = 3  # of the pool of workers, after which the run is given up


class Named(Protocol):
    """What is to be made, by its name."""

    @property
    def name(self) -> str: ...


def watch_parent(parent: int) -> None:
    """End this worker when the command that started it is gone, even if it was killed."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(2.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@dataclass
class Workers[T: Named]:
    """Processes that make trials side by side. make: a trial in a folder, whole or not at all. failures: {trial: error}, filled as they
    happen."""

    make: Callable[[T, Path], object]
    folder: Path
    jobs: int
    progress: Progress
    failures: dict[str, str] = field(default_factory=dict)

    def run(self, plans: Sequence[T]) -> None:
        """Make trials in this order; errors go to `failures`. Raises `BrokenExecutor` when a worker dies.

        Workers are renewed all at once: `max_tasks_per_child` stops for good in some versions of Python (gh-115634).
        """
        spawn = multiprocessing.get_context("spawn")
        for batch in batched(plans, self.jobs * RENEWED):
            with ProcessPoolExecutor(self.jobs, spawn, watch_parent, (os.getpid(),)) as pool:
                self._collect(pool, batch)

    def _collect(self, pool: ProcessPoolExecutor, batch: Sequence[T]) -> None:
        tasks = {pool.submit(self.make, plan, self.folder): plan for plan in batch}
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


def make_missing[T: Named](
    make: Callable[[T, Path], object],
    folder: Path,
    jobs: int,
    total: int,
    missing: Callable[[], Sequence[T]],
    title: str,
) -> dict[str, str]:
    """Make every trial that is `missing` of `total`, again where workers die; returns the errors by trial.

    make: importable, since every worker starts anew. Raises `StudyError` when workers die again and again.
    """
    workers = Workers(make, folder, jobs, Progress(title, total, "trial"))
    for _ in range(BREAKDOWNS):
        todo = missing()
        workers.progress.to(total - len(todo))
        try:
            workers.run([plan for plan in todo if plan.name not in workers.failures])
        except BrokenExecutor:  # a worker was killed: for memory, or by hand
            continue
        workers.progress.close()
        return workers.failures
    raise StudyError(
        f"workers were killed {BREAKDOWNS} times, perhaps for want of memory; give --jobs 1, and the same "
        f"command again: {total - len(missing())} of {total} trials are kept"
    )
