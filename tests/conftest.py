"""What holds for every test: compiled code is kept between runs, and no process is killed for the memory maps it takes."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Iterator
from pathlib import Path

import jax
import pytest

MAPS = Path("/proc/self/maps")
MANY = 20_000  # of the 65530 that Linux allows a process (vm.max_map_count); beyond them it ends without a word
COMPILED = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "equigap" / "tests"
OLD = 14 * 24 * 3600  # seconds after which what was compiled for a test is forgotten
SETTINGS = {"jax_compilation_cache_dir": str(COMPILED), "jax_persistent_cache_min_compile_time_secs": 0.1}


def pytest_configure() -> None:
    """Workers, and the commands that tests start, share what JAX has compiled. Half a file of a killed process is compiled again."""
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    COMPILED.mkdir(parents=True, exist_ok=True)
    for path in COMPILED.iterdir():
        if time.time() - path.stat().st_mtime > OLD:
            path.unlink(missing_ok=True)
    for name, value in SETTINGS.items():
        os.environ[name.upper()] = str(value)
        jax.config.update(name, value)


@pytest.fixture(autouse=True, scope="module")
def few_memory_maps() -> Iterator[None]:
    """Forget compiled code after a module of tests where much has gathered."""
    yield
    if MAPS.exists() and len(MAPS.read_bytes().splitlines()) > MANY:
        jax.clear_caches()
        gc.collect()
