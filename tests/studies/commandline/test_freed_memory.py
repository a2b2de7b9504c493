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


@pytest.mark.skipif(sys.platform != "linux", reason="malloc_trim is glibc's")
def test_what_is_freed_between_blocks_in_use_goes_back() -> None:
    """300 MB in blocks, 290 of them freed: without it most stay with the process."""

    def returned(call: str) -> float:
        script = MAKE_HOLES.replace("CALL", call)
        return float(subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout)

    assert returned("give_back(0.05)") > 200
    assert returned("") < 100


def test_a_process_that_runs_many_commands_has_one_thread() -> None:
    """Tests and the study run commands by the hundred in one process."""
    done = subprocess.run([sys.executable, "-c", ASK_TWICE], capture_output=True, text=True, check=True)
    assert int(done.stdout) <= 2
