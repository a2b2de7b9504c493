"""Curved edges from points alone: edges of an outline in, how far the middle of each lies off its chord out.

Through the points of every smooth run of edges goes the cubic spline with the centripetal parameter, the root of the length of the chords (Lee 1989, Comput.-Aided
Des. 21): closed around a hole, without curvature at an end. A run ends where no edge follows or two do, and at a corner. Of fourth order in
the distance of points on a smooth curve, where chords are of second.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
CORNER = np.radians(65)  # a larger turn between two edges may be a corner
SHARPEST = np.radians(85)  # turn of a curve, where both turns beside it are of its sense, no sharper, and at least
BESIDE = 0.3  # of its size, as at the tip of an ellipse of few points
NO_EDGE = -1


def rises(points: Array, edges: Indices, most: Array) -> Array:
    """Rise (k, 2), mm, of the curve above the middle of each edge (k, 2) of points (n, 2), normal to it, and of at most `most` (k,)."""
    found = np.zeros((len(edges), 2))
    for run, closed in _runs(points, edges):
        found[run] = _off_chords(points[np.append(edges[run, 0], edges[run[-1], 1])], closed)
    along = points[edges[:, 1]] - points[edges[:, 0]]
    normal = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    return np.clip((found * normal).sum(axis=1), -most, most)[:, None] * normal


def _off_chords(places: Array, closed: bool) -> Array:
    """From the middles of the chords (q - 1, 2) between places (q, 2) to the spline."""
    if len(places) < 3:
        return np.zeros((len(places) - 1, 2))
    chords = np.linalg.norm(np.diff(places, axis=0), axis=1)
    t = np.append(0.0, np.cumsum(np.sqrt(chords)))
    spline = CubicSpline(t, places, bc_type="periodic" if closed else "natural")
    return spline((t[1:] + t[:-1]) / 2) - (places[1:] + places[:-1]) / 2


def _runs(points: Array, edges: Indices) -> list[tuple[Indices, bool]]:
    """Edges of each smooth run in their order, and whether it is closed."""
    after = _followers(points, edges)
    begun = np.setdiff1d(np.arange(len(edges)), after)
    open_runs = [(_run(after, int(first)), False) for first in begun]
    left = np.setdiff1d(np.arange(len(edges)), np.concatenate([run for run, _ in open_runs] or [np.empty(0, int)]))
    closed_runs = []
    while left.size:
        run = _run(after, int(left[0]))
        closed_runs.append((run, True))
        left = np.setdiff1d(left, run)
    return open_runs + closed_runs


def _run(after: Indices, first: int) -> Indices:
    run, edge = [first], int(after[first])
    while edge not in (NO_EDGE, first):
        run.append(edge)
        edge = int(after[edge])
    return np.array(run)


def _followers(points: Array, edges: Indices) -> Indices:
    """The edge (k,) that goes on smoothly from each, or `NO_EDGE`."""
    count = np.bincount(edges[:, 0], minlength=len(points))
    starting = np.full(len(points), NO_EDGE)
    starting[edges[:, 0]] = np.arange(len(edges))
    after = np.where(count[edges[:, 1]] == 1, starting[edges[:, 1]], NO_EDGE)
    one, other = (points[e[:, 1]] - points[e[:, 0]] for e in (edges, edges[after]))
    turn = np.arctan2(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0], (one * other).sum(axis=1))
    return np.where(is_smooth(turn, after), after, NO_EDGE)


def is_smooth(turn: Array, after: Indices, corner: float = CORNER) -> NDArray[np.bool_]:
    """(k,): whether an outline has no corner behind each edge. turn (k,): from it to the edge that follows, after (k,), `NO_EDGE` where none does."""
    follows = after != NO_EDGE
    turn = np.where(follows, turn, 0.0)
    before = np.zeros(len(turn))
    before[after[follows]] = turn[follows]
    all_three = np.sign(turn) * np.stack([before, turn, np.where(follows, turn[after], 0.0)])
    curves = (all_three.max(axis=0) < SHARPEST) & (all_three.min(axis=0) >= BESIDE * np.abs(turn))
    return (np.abs(turn) < corner) | curves
