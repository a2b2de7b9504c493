"""Independent pieces of work on all cores: in threads, as compiled code and linear algebra run without Python's lock.

In: a function and its arguments. Out: what it returns, in their order, to the last digit as one after the other.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor

MOST = 2  # threads: each needs memory of its own, and what is not compiled waits for the others


def side_by_side[T, R](work: Callable[[T], R], arguments: Iterable[T]) -> list[R]:
    """Raises what the first piece that fails raises."""
    some, count = list(arguments), threads()
    if min(count, len(some)) < 2:
        return [work(one) for one in some]
    with ThreadPoolExecutor(count) as pool:
        try:
            return list(pool.map(work, some))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def threads() -> int:
    """How many: one in a process beside others of the same command, which have the other cores."""
    if multiprocessing.parent_process() is not None:
        return 1
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(MOST, cores)
