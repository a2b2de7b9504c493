"""Memory that is freed goes back to the system while a command runs: a diagnosis holds a tenth less of it.

The C library keeps what lies between blocks that are still in use. A diagnosis makes and frees arrays of all sizes beside compiled code that stays.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable

EVERY = 2.0  # s; a call takes some milliseconds
NAME = "freed memory"  # of the thread, of which a process has one


def give_back(every: float = EVERY) -> bool:
    """Have it done every so many seconds, until the process ends, however often it is asked for; False where the C library has no `malloc_trim` (it is glibc's)."""
    if any(one.name == NAME for one in threading.enumerate()):
        return True
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError):
        return False
    threading.Thread(target=_repeat, args=(lambda: trim(0), every), name=NAME, daemon=True).start()
    return True


def _repeat(call: Callable[[], object], every: float) -> None:
    pause = threading.Event()
    while not pause.wait(every):
        call()
