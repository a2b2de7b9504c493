"""Memory that is freed is kept for what is made next; what is left of it goes back to the system every few seconds.

The C library maps an array of 32 MB or more by itself, page by page, and gives it back as soon as it is freed: some hundredths of the time of a diagnosis. It keeps what lies between
blocks that are still in use, and a diagnosis makes and frees arrays of all sizes beside compiled code that stays: a tenth of its memory.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable

EVERY = 5.0  # s; a call takes some milliseconds, and of a large diagnosis some tens
NAME = "freed memory"  # of the thread, of which a process has one
TRIM_ABOVE, MAP_ABOVE = -1, -3  # parameters of mallopt(3)
LARGE = 64 << 20  # bytes, of an array that is mapped by itself


def give_back(every: float = EVERY) -> bool:
    """Have it done every so many seconds, until the process ends, however often it is asked for; False where the C library has no `malloc_trim` (it is glibc's)."""
    if any(one.name == NAME for one in threading.enumerate()):
        return True
    try:
        library = ctypes.CDLL(None)
        trim, option = library.malloc_trim, library.mallopt
    except (AttributeError, OSError):
        return False
    option(MAP_ABOVE, LARGE)
    option(TRIM_ABOVE, 2 * LARGE)
    threading.Thread(target=_repeat, args=(lambda: trim(0), every), name=NAME, daemon=True).start()
    return True


def _repeat(call: Callable[[], object], every: float) -> None:
    pause = threading.Event()
    while not pause.wait(every):
        call()
