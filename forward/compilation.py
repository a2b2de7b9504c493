"""Compiled forms, kept between runs in a folder that several processes may share and any of them may be killed in.

FFCx claims a form by an empty ``.c`` file and ends with a ``.c.cached`` one. A process killed in between leaves the
claim, on which every later one waits in vain. Here who compiles holds a shared lock, which dies with its process. Who
gets the lock for itself knows that nobody compiles, and removes what is unfinished.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import platform
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from forward._dolfinx import cffi, dolfinx
from forward.errors import FormsCacheError, MissingSolverError

FOLDER = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "equigap" / "forms"
PATIENCE = 300  # seconds for which a form is awaited that another process compiles


def _processor() -> str:
    """Hash of what this processor can do; forms compiled for another one are then not taken from a shared cache."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.machine()
    return hashlib.sha256(next((line for line in lines if line.startswith("flags")), "").encode()).hexdigest()[:12]


FLAGS = ["-O3", "-march=native", "-ffast-math", "-fno-finite-math-only", f"-DEQUIGAP_PROCESSOR={_processor()}"]
JIT_OPTIONS = {"cffi_extra_compile_args": FLAGS, "cache_dir": FOLDER, "timeout": PATIENCE}


def compiled_form(form: Any) -> Any:
    """A compiled UFL form. Raises `MissingSolverError`, `FormsCacheError`."""
    with compilation():
        return dolfinx.fem.form(form, jit_options=JIT_OPTIONS)


def compiled_expression(value: Any, points: Any) -> Any:
    """UFL `value` compiled at `points` of a reference cell. Raises `MissingSolverError`, `FormsCacheError`."""
    with compilation():
        return dolfinx.fem.Expression(value, points, jit_options=JIT_OPTIONS)


def compiled_problem(forces: Any, unknowns: Any, **settings: Any) -> Any:
    """DOLFINx's `NonlinearProblem` with compiled forms. Raises `MissingSolverError`, `FormsCacheError`."""
    with compilation():
        return dolfinx.fem.petsc.NonlinearProblem(forces, unknowns, jit_options=JIT_OPTIONS, **settings)


@contextlib.contextmanager
def compilation(folder: Path = FOLDER) -> Iterator[None]:
    """Around whatever compiles forms with `JIT_OPTIONS`.

    Raises `MissingSolverError` where there is no working C compiler, `FormsCacheError` where the folder cannot be
    written or a form does not come.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = open(folder / "lock", "a")  # noqa: SIM115
    except OSError as error:
        raise FormsCacheError(f"{folder}: compiled forms cannot be kept there ({error.strerror}); set XDG_CACHE_HOME "
                              "to a folder that can be written") from error  # fmt: skip
    with lock:
        with contextlib.suppress(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _remove_unfinished(folder)
        fcntl.flock(lock, fcntl.LOCK_SH)
        try:
            yield
        except cffi.VerificationError as error:
            raise MissingSolverError(
                f"the forms cannot be compiled ({str(error).splitlines()[0]}); a C compiler is needed, on Debian or "
                "Ubuntu: apt-get install -y gcc libc6-dev"
            ) from error
        except TimeoutError as error:
            raise FormsCacheError(f"{folder}: a form that another process claimed did not come in {PATIENCE} s; "
                                  "end the processes that hang and try again") from error  # fmt: skip


def _remove_unfinished(folder: Path) -> None:
    """Forms that are claimed but not ready, or ready but not claimed."""
    names = {entry.name for entry in os.scandir(folder)}
    claimed = {name for name in names if name.endswith(".c")}
    ready = {name.removesuffix(".cached") for name in names if name.endswith(".c.cached")}
    for name in claimed ^ ready:
        for unfinished in (name, f"{name}.cached"):
            (folder / unfinished).unlink(missing_ok=True)
