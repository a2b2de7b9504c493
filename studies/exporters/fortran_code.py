"""Fortran that was generated, compiled and called from here: what its certificate is measured with."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from studies.errors import ExportError

COMPILER = "gfortran"


def compiler() -> str | None:
    """The path of gfortran, or None."""
    return shutil.which(COMPILER)


def compiled(source: str, subroutine: str) -> Callable[..., None]:
    """A subroutine of fixed-form source as a function; arguments: arrays of float64 or int32, taken by reference.

    Raises `ExportError` with the first message of the compiler where the source is refused.
    """
    with tempfile.TemporaryDirectory() as folder:
        code, library = Path(folder, "law.f"), Path(folder, "law.so")
        code.write_text(source)
        done = subprocess.run(
            [COMPILER, "-O2", "-fPIC", "-shared", "-Wall", "-Wno-unused-dummy-argument", "-o", str(library), str(code)],
            capture_output=True, text=True, timeout=120,
        )  # fmt: skip
        if done.returncode:
            raise ExportError(f"gfortran refuses the generated code: {done.stderr.strip()[:300]}; report it")
        function = getattr(ctypes.CDLL(str(library)), f"{subroutine.lower()}_")
    function.restype = None

    def call(*arguments: Any) -> None:
        function(*(a.ctypes.data_as(ctypes.c_void_p) if isinstance(a, np.ndarray) else a for a in arguments))

    return call
