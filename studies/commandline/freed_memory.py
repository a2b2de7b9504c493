"""Memory that is freed goes back to the system while a command runs: a diagnosis holds a tenth less of it.

The C library keeps what lies between blocks that are still in use. A diagnosis makes and frees arrays of all sizes beside compiled code that stays.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable

EVERY = 2.0  # s; a call takes some milliseconds


def give_back(every: float = EVERY) -> bool:
    """Have it done every so many seconds, until the process ends; False where the C library has no `malloc_trim` (it is glibc's)."""
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError):
        return False
    threading.Thread(target=_repeat, args=(lambda: trim(0), every), name="freed memory", daemon=True).start()
    return True


def _repeat(call: Callable[[], object], every: float) -> None:
    pause = threading.Event()
    while not pause.wait(every):
        call()
