"""Spurious points of a measured field: a local robust test in space, and in time.

In: points, displacements of some frames. Out: which points are not to be trusted, and by how much.

In space each displacement is compared with a plane through those of its neighbours, fitted robustly (iteratively reweighted, biweight
of Beaton and Tukey 1974), so that a spurious neighbour does not count. The distance from that plane is divided by what is usual there:
the median distance of the neighbours, or of the whole frame, whichever is larger (normalised median test; Westerweel and Scarano 2005).
At a hole or a tip the neighbours are far from their planes too, so that steep fields are not taken for errors. In time a point is
spurious where its path jumps (second differences), compared with the jumps of its neighbours in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]
Index = NDArray[np.int64]
NEIGHBOURS = 12
ROUNDS, TUNING = 4, 4.7  # of the reweighting; width of the biweight in deviations
REPEATS = 5  # at most
LIMIT = 7.0  # usual distances, from which a point is spurious
FLOOR = 1e-3  # of the distance of the points, below which no distance counts
MOST_FRAMES = 25  # that are looked at
TO_DEVIATION = 1.4826


@dataclass(frozen=True)
class Outliers:
    """index (k,): of the spurious points. score (n,): largest distance from the neighbours over the usual one."""

    index: Index
    score: Array


def outliers(points: Array, displacements: Array, limit: float = LIMIT) -> Outliers:
    """Spurious ones among points (n, 2) mm with displacements (n_frames, n, 2) mm; NaN (failed points) are left out.

    Repeated without those found: a spurious point makes what is usual around it too large.
    """
    frames = displacements[_spread(len(displacements))]
    found = np.zeros(len(points))
    for _ in range(REPEATS):
        score = _scores(points, frames, np.isfinite(frames).all(axis=(0, 2)) & (found <= limit))
        found = np.maximum(found, score)
        if not (score > limit).any():
            break
    return Outliers(np.flatnonzero(found > limit), found)


def _scores(points: Array, frames: Array, used: NDArray[np.bool_]) -> Array:
    """(n,): the larger of both tests, 0 of points that are not used."""
    score = np.zeros(len(points))
    usable = np.flatnonzero(used)
    if usable.size < 2 * NEIGHBOURS:
        return score
    places, fields = points[usable], np.moveaxis(frames[:, usable], 0, 1).reshape(usable.size, -1)
    distance, near = cKDTree(places).query(places, k=NEIGHBOURS + 1)
    pitch = float(np.median(distance[:, 1]))
    offsets = (places[near[:, 1:]] - places[:, None]) / pitch
    jumps = frames[2:, usable] - 2 * frames[1:-1, usable] + frames[:-2, usable]
    in_time = np.moveaxis(jumps, 0, 1).reshape(usable.size, -1)
    reach = _reach(offsets)[:, None]  # a plane that reaches beyond its neighbours, as at an edge, is less certain
    distances = [
        _lengths(values - _planes(offsets, values[near[:, 1:]], FLOOR * pitch)) / reach for values in (fields, in_time)
    ]
    for size in distances:
        if size.shape[1]:
            usual = np.maximum(np.median(size[near[:, 1:]], axis=1), np.median(size, axis=0))
            ratio = size / (TO_DEVIATION * np.maximum(usual, FLOOR * pitch))
            score[usable] = np.maximum(score[usable], ratio.max(axis=1))
    return score


def _spread(n: int) -> Index:
    """At most `MOST_FRAMES` of n frames, evenly spread, the last among them."""
    return np.unique(np.linspace(0, n - 1, min(n, MOST_FRAMES)).round().astype(np.int64))


def _lengths(values: Array) -> Array:
    """(n, k): lengths of n times k vectors, given as (n, 2 k)."""
    return np.linalg.norm(values.reshape(len(values), -1, 2), axis=2)


def _reach(offsets: Array) -> Array:
    """(n,): root of 1 + the leverage of the point itself in a plane through its neighbours at offsets (n, neighbours, 2)."""
    A = np.concatenate([np.ones((*offsets.shape[:2], 1)), offsets], axis=2)
    inverse = np.linalg.pinv(np.einsum("nji,njl->nil", A, A))
    return np.asarray(np.sqrt(1 + inverse[:, 0, 0]))


def _planes(offsets: Array, values: Array, floor: float) -> Array:
    """(n, k): at the point itself, the plane through values (n, neighbours, k) at offsets (n, neighbours, 2)."""
    A = np.concatenate([np.ones((*offsets.shape[:2], 1)), offsets], axis=2)
    weights = np.ones_like(values)
    planes = np.zeros((len(values), values.shape[2], 3))
    for _ in range(ROUNDS):
        normal = np.einsum("nji,njk,njl->nkil", A, weights, A) + 1e-9 * np.eye(3)
        right = np.einsum("nji,njk,njk->nki", A, weights, values)
        planes = np.linalg.solve(normal, right[..., None])[..., 0]
        rest = values - np.einsum("nji,nki->njk", A, planes)
        spread = TO_DEVIATION * np.median(np.abs(rest), axis=1, keepdims=True)
        x = rest / (TUNING * np.maximum(spread, floor))
        weights = np.where(np.abs(x) < 1, (1 - x**2) ** 2, 0.0) + 1e-6
    return planes[..., 0]
