"""Memory between blocks that are in use goes back to the system."""

import subprocess
import sys

import pytest

ASK_TWICE = """
import threading
from studies.commandline.freed_memory import give_back
assert give_back() == give_back()
print(threading.active_count())
"""
MAKE_AND_FREE = """
import resource
import numpy as np
from studies.commandline.freed_memory import give_back

CALL
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(50):
    np.ones(5_000_000)  # 40 MB
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""
MAKE_HOLES = """
import time
from studies.commandline.freed_memory import give_back

def held():
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 1e6

blocks = [bytearray(100_000) for _ in range(3000)]
CALL
full = held()
blocks = blocks[::30]
time.sleep(0.5)
print(full - held())
"""


def printed(script: str, call: str) -> float:
    """What a script prints in which CALL is a call."""
    words = [sys.executable, "-c", script.replace("CALL", call)]
    return float(subprocess.run(words, capture_output=True, text=True, check=True).stdout)


@pytest.mark.skipif(sys.platform != "linux", reason="malloc_trim is glibc's")
def test_what_is_freed_between_blocks_in_use_goes_back() -> None:
    """300 MB in blocks, 290 of them freed: without it most stay with the process."""

    assert printed(MAKE_HOLES, "give_back(0.05)") > 200
    assert printed(MAKE_HOLES, "") < 100


@pytest.mark.skipif(sys.platform != "linux", reason="mallopt is glibc's")
def test_arrays_that_follow_each_other_take_the_same_pages() -> None:
    """Fifty of 40 MB: else each has pages of its own, all of them cleared before."""
    assert printed(MAKE_AND_FREE, "give_back(60.0)") < 0.2 * printed(MAKE_AND_FREE, "")


def test_a_process_that_runs_many_commands_has_one_thread() -> None:
    """Tests and the study run commands by the hundred in one process."""
    done = subprocess.run([sys.executable, "-c", ASK_TWICE], capture_output=True, text=True, check=True)
    assert int(done.stdout) <= 2
