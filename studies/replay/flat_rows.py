"""Rows of several replayed tests as the flat rows that a diagnosis compares, see `calibrate.diagnosis.replayed.observations`."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.replayed.observations import Observations
from studies.replay.compared_test import ComparedTest
from studies.replay.replay_rows import SheetRows

Array = NDArray[np.float64]


def observations(tests: Sequence[ComparedTest], found: Sequence[SheetRows]) -> Observations:
    """Rows of all tests, those of a test after each other."""
    parts: dict[str, list[Array]] = {
        key: [] for key in ("test", "increment", "held", "is_force", "measured", "replayed")
    }
    labels: list[str] = []
    size = max(len(test.held) for test in tests)
    squares = np.full((len(found), size), np.nan)
    for i, (test, rows) in enumerate(zip(tests, found, strict=True)):
        k, r = rows.measured.shape
        given = (np.full(k * r, i), np.repeat(test.layout.chosen, r), np.repeat(test.held[test.layout.chosen], r),
                 np.tile(test.layout.is_force, k), rows.measured.ravel(), rows.replayed.ravel())  # fmt: skip
        for key, values in zip(parts, given, strict=True):
            parts[key].append(values)
        labels += test.layout.labels(test.experiment) * k
        squares[i, test.layout.chosen] = rows.squares
    noise = _block_diagonal([rows.noise for rows in found])
    points = np.array([int(np.any(test.layout.weights, axis=0).sum()) for test in tests])
    flat = {key: np.concatenate(values) for key, values in parts.items()}
    return Observations(**flat, noise=noise, labels=tuple(labels), squares=squares, points=points)  # type: ignore[arg-type]


def judging(
    rows: Observations, tests: Sequence[ComparedTest], apart: Collection[str], levels: Collection[str]
) -> NDArray[np.bool_]:
    """Rows (N,) that may judge a model of all tests: not of those named `apart`, nor forces of those with `levels` of their own."""
    names = [test.part.experiment.name for test in tests]
    alone, of_level = (np.isin(names, list(some))[rows.test] for some in (apart, levels))
    return np.asarray(~alone & ~(of_level & rows.is_force))


def _block_diagonal(blocks: Sequence[Array]) -> Array:
    size = sum(len(block) for block in blocks)
    found, start = np.zeros((size, size)), 0
    for block in blocks:
        found[start : start + len(block), start : start + len(block)] = block
        start += len(block)
    return found
