"""How many threads linear algebra uses: one, as the matrices of a diagnosis are many and small.

Two threads are no faster and take 1.35 times the CPU time, beside another process on the same two cores 1.7 times; 16 are a third slower (`docs/discover.md`, what it
costs).
"""

from __future__ import annotations

import os

VARIABLE, CHOSEN_BY = "OPENBLAS_NUM_THREADS", ("OPENBLAS_NUM_THREADS", "GOTO_NUM_THREADS", "OMP_NUM_THREADS")
MOST = 1


def limit() -> None:
    """Have NumPy and SciPy, if they are imported after this, use `MOST` threads, here and in commands that are started from here; what the user has chosen is left as it is."""
    if not any(name in os.environ for name in CHOSEN_BY):
        os.environ[VARIABLE] = str(MOST)
