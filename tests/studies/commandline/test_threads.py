"""Threads of linear algebra: one, unless the user has chosen."""

import os
import subprocess
import sys

import pytest

from studies.commandline import threads

CODE = """
import ctypes, pathlib
from studies.commandline import threads
threads.limit()
import numpy
libraries = sorted((pathlib.Path(numpy.__file__).parents[1] / "numpy.libs").glob("libscipy_openblas*"))
print(ctypes.CDLL(str(libraries[0])).scipy_openblas_get_num_threads64_() if libraries else 0)
"""


def blas_threads(**chosen: str) -> int:
    """Of the OpenBLAS that NumPy brings, in a new process; 0 where it brings none."""
    environment = {k: v for k, v in os.environ.items() if k not in threads.CHOSEN_BY} | chosen
    done = subprocess.run([sys.executable, "-c", CODE], env=environment, capture_output=True, text=True, check=True)
    return int(done.stdout)


def test_linear_algebra_has_one_thread_unless_the_user_chose():
    """The loaded OpenBLAS itself is asked."""
    found = blas_threads()
    if not found or (os.cpu_count() or 1) < 2:
        pytest.skip("NumPy without its own OpenBLAS, or one core")
    assert found == 1
    assert blas_threads(OPENBLAS_NUM_THREADS="2") == 2
    assert blas_threads(OMP_NUM_THREADS="2") == 2


def test_what_the_user_chose_is_left(monkeypatch):
    """Any of the three names that OpenBLAS reads counts."""
    for name in threads.CHOSEN_BY:
        monkeypatch.delenv(name, raising=False)
    threads.limit()
    assert os.environ[threads.VARIABLE] == str(threads.MOST)
    for name in threads.CHOSEN_BY:
        monkeypatch.delenv(threads.VARIABLE, raising=False)
        monkeypatch.setenv(name, "7")
        threads.limit()
        assert os.environ.get(threads.VARIABLE) == ("7" if name == threads.VARIABLE else None)
        monkeypatch.delenv(name)
