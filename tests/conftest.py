"""What holds for every test: compiled code is kept between runs, and no process is killed for the memory maps it takes."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from pathlib import Path

import jax
import pytest

from studies.commandline import compiled_code

MAPS = Path("/proc/self/maps")
MANY = 20_000  # of the 65530 that Linux allows a process (vm.max_map_count); beyond them it ends without a word


def pytest_configure() -> None:
    """Workers, and the commands that tests start, share what JAX has compiled. Half a file of a killed process is compiled again."""
    if compiled_code.keep():
        jax.config.update("jax_compilation_cache_dir", os.environ[compiled_code.VARIABLE])
        jax.config.update("jax_persistent_cache_min_compile_time_secs", compiled_code.SHORTEST)


@pytest.fixture(autouse=True, scope="module")
def few_memory_maps() -> Iterator[None]:
    """Forget compiled code after a module of tests where much has gathered."""
    yield
    if MAPS.exists() and len(MAPS.read_bytes().splitlines()) > MANY:
        jax.clear_caches()
        gc.collect()
