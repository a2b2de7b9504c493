"""Pieces of work side by side return what they return one after the other, in their order, and raise what the first that fails raises."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest

from calibrate.fitting import side_by_side as module
from calibrate.fitting.side_by_side import side_by_side, threads


@pytest.fixture(params=[1, 2, 4])
def count(request, monkeypatch):
    monkeypatch.setattr(module, "threads", lambda: request.param)
    return request.param


def test_results_are_in_the_order_of_the_arguments(count):
    """Also where the first takes longest."""
    assert side_by_side(lambda i: (time.sleep(0.02 * (4 - i)), i * i)[1], range(5)) == [0, 1, 4, 9, 16]
    assert side_by_side(str, []) == []


def test_they_run_at_the_same_time():
    """Each waits for the other."""
    meet = threading.Barrier(2, timeout=20)
    if threads() > 1:
        assert sorted(side_by_side(lambda _: meet.wait(), range(2))) == [0, 1]


def test_what_the_first_that_fails_raises_is_raised(count):
    def work(i):
        if i:
            raise ValueError(f"piece {i}")
        return i

    with pytest.raises(ValueError, match="piece 1"):
        side_by_side(work, range(3))


def test_a_process_beside_others_uses_one_thread():
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        assert pool.submit(threads).result() == 1
