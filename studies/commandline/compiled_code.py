"""What JAX has compiled is kept between commands, in the user's cache folder, so that a second command need not compile it again."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path

from studies.commandline.cache_folder import cache_folder

FOLDER = cache_folder() / "compiled"
OLD = 14 * 24 * 3600.0  # s after which compiled code is forgotten
VARIABLE, LEAST = "JAX_COMPILATION_CACHE_DIR", "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"
SHORTEST = 0.0  # s of compilation that are worth a file


def keep(folder: Path = FOLDER) -> bool:
    """Have JAX keep what it compiles, if it is imported after this, here and in commands that are started from here; False where the
    folder cannot be written: everything works without it.

    A folder that the user has chosen by JAX_COMPILATION_CACHE_DIR is left as it is. Half a file of a killed process is compiled again.
    """
    if VARIABLE in os.environ:
        return True
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    if not os.access(folder, os.W_OK):
        return False
    _forget(folder, time.time() - OLD)
    os.environ[VARIABLE] = str(folder)
    os.environ.setdefault(LEAST, str(SHORTEST))
    return True


def _forget(folder: Path, before: float) -> None:
    """Delete files that are older."""
    for path in folder.iterdir():
        with suppress(OSError):  # another command may have deleted it
            if path.stat().st_mtime < before:
                path.unlink()
