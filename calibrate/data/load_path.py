"""Increments between which a test goes in straight lines, so that what is smooth in the load is known from them.

In: displacements (t, n, 2), mm. Out: increments, and the shares of these in every one. `turning_points` are for what is nothing at rest, `samples`
for what is not, such as a tangent.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEP, BEND = 0.25, 0.02  # of the largest displacement: the length of a line, and how far an increment may be off it
LINE = 0.4  # the same length of a line that is sampled at its ends and its middle
MIDDLE = 0.25, 0.75  # places on a line, between which an increment is its middle


def samples(displacements: Array) -> tuple[NDArray[np.int64], Array]:
    """Increments (k,) at the ends and the middles of straight lines through displacements (t, n, 2), mm, the first increment among them; and shares (t, k) of
    the parabola through the three of a line, so that what has the values (k, ...) there is about shares @ values."""
    u = displacements.reshape(len(displacements), -1) - displacements[:1].reshape(1, -1)
    chosen, rows = [0], [{0: 1.0}]
    for start, end in pairwise(_ends_of_lines(u, LINE)):
        places = _along(u[start : end + 1])[0]
        nearest = int(np.argmin(np.abs(places - 0.5)))
        middle = start + 1 + nearest if MIDDLE[0] <= places[nearest] <= MIDDLE[1] else None
        chosen += [end] if middle is None else [middle, end]
        at = {start: 0.0, end: 1.0} if middle is None else {start: 0.0, middle: float(places[nearest]), end: 1.0}
        rows += [_lagrange(at, float(place)) for place in places]
    shares = np.zeros((len(rows), len(chosen)))
    for i, row in enumerate(rows):
        shares[i, [chosen.index(sample) for sample in row]] = list(row.values())
    return np.array(chosen, np.int64), shares


def _lagrange(at: dict[int, float], place: float) -> dict[int, float]:
    """Values at a place of the polynomials that are 1 at one of the samples {increment: place} and 0 at the others."""
    return {
        i: float(np.prod([(place - y) / (x - y) for j, y in at.items() if j != i], initial=1.0)) for i, x in at.items()
    }


def turning_points(displacements: Array, step: float = STEP) -> tuple[NDArray[np.int64], Array]:
    """Ends (k,) of straight lines from rest through displacements (t, n, 2), mm, counted from 0; and where every increment lies between two
    of them, shares (t, k) of both: what is nothing at rest and has the values (k, ...) at the ends is about shares @ values."""
    flat = displacements.reshape(len(displacements), int(np.prod(displacements.shape[1:])))
    u = np.concatenate([np.zeros((1, flat.shape[1])), flat])
    ends = _ends_of_lines(u, step)
    shares = np.zeros((len(displacements), len(ends) - 1))
    for j, (start, end) in enumerate(pairwise(ends)):
        places = _along(u[start : end + 1])[0]
        shares[start:end, j] = places
        if j:
            shares[start:end, j - 1] = 1 - places
    return np.array(ends[1:], np.int64) - 1, shares


def _ends_of_lines(u: Array, step: float) -> list[int]:
    """Rows of u (t + 1, m) from the first to the last, between which it goes straight, by `step` of the largest at most."""
    largest = float(np.linalg.norm(u, axis=1).max())
    ends = [0]
    while ends[-1] + 1 < len(u):
        ends.append(_end_of_line(u, ends[-1], step * largest, BEND * largest))
    return ends


def _end_of_line(u: Array, start: int, longest: float, bend: float) -> int:
    """Of the longest line from a row of u (t + 1, m)."""
    end = start + 1
    while end + 1 < len(u):
        length, off = np.linalg.norm(u[end + 1] - u[start]), _along(u[start : end + 2])[1]
        if length > (1 + 1e-9) * longest or off > bend:
            break
        end += 1
    return end


def _along(u: Array) -> tuple[Array, float]:
    """Places (k - 1,), 0 to 1, of all rows of u (k, m) but the first on the line from the first to the last, and how far the worst is off."""
    line, moved = u[-1] - u[0], u[1:] - u[0]
    places = np.clip(moved @ line / max(float(line @ line), 1e-300), 0.0, 1.0)
    places[-1] = 1.0
    return places, float(np.linalg.norm(moved - places[:, None] * line, axis=1).max())
