"""Spurious points of a measured field: local robust tests in space, and in time.

In: points, displacements of some frames. Out: which points are not to be trusted, and by how much.

Each displacement is compared with surfaces through those of its neighbours, fitted robustly, so that spurious neighbours do not count:

- a plane through the `NEAREST` (iteratively reweighted, biweight of Beaton and Tukey 1974);
- a plane and a quadratic through the `CLUSTER` nearest, started from the plane of least median distance among some through three of
  them (Rousseeuw 1984), which up to half of them cannot spoil: spurious points come in clusters.

The distance is divided by what is usual there: the median distance of the neighbours, or of the whole frame, whichever is larger
(normalised median test; Westerweel and Scarano 2005). At a hole or a tip the neighbours are far from their planes too, so that steep
fields are not taken for errors. With the many neighbours the usual distance is that of the nearer surface, and by how much plane and
quadratic differ nearby is added to it: what is left is noise, of which less is allowed. In time the same is done with the second
differences of each path.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibrate.robust_deviation import TO_DEVIATION
from meshes.mesh import spacing_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]
NEAREST, CLUSTER = 12, 30  # neighbours
LIMIT, NOISE_LIMIT = (
    7.0,
    3.0,
)  # usual distances, from which a point is spurious; the latter are some eight standard deviations of normal noise
CURVATURE = 2.0  # times the largest difference of plane and quadratic nearby, that is no error
ROUNDS, TUNING = 4, 4.7  # of the reweighting; width of the biweight in usual distances
TRIPLES = 24  # planes to start from: with four of ten neighbours spurious one in 1500 points finds none that is good
REPEATS = 5  # at most
FLOOR = 1e-3  # of the distance of the points, below which no distance counts
MOST_FRAMES = 25  # that are looked at
WORK, FEW_FRAMES = (
    10_000,
    (6, 20),
)  # points times frames that are looked at with many neighbours; frames, at least and at most
CHUNK = 400  # points fitted at once


@dataclass(frozen=True)
class Outliers:
    """index (k,): of the spurious points. score (n,): largest distance over the one from which a point is spurious."""

    index: Index
    score: Array


def outliers(points: Array, displacements: Array) -> Outliers:
    """Spurious ones among points (n, 2) mm with displacements (n_frames, n, 2) mm; NaN (failed points) are left out.

    Repeated with neighbours that were not found, until no more are: a spurious point makes what is usual around it too large. What was
    found is tested again beside neighbours that were not: a point that only looked wrong beside a spurious one is good.
    """
    frames = displacements[_spread(len(displacements))]
    known = np.isfinite(frames).all(axis=(0, 2))
    score = np.zeros(len(points))
    if known.sum() < 2 * CLUSTER:
        return Outliers(np.flatnonzero(score), score)
    places, paths = points[known], frames[:, known]
    found = np.zeros(len(places), bool)
    for _ in range(REPEATS):
        score[known] = _scores(places, paths, ~found)
        both = found | (score[known] > 1)
        if (both == found).all() or (~both).sum() < 2 * CLUSTER:
            break
        found = both
    else:
        score[known] = _scores(places, paths, ~found)
    found &= score[known] > 1
    return Outliers(np.flatnonzero(known)[found], score)


def _scores(points: Array, frames: Array, trusted: Flags) -> Array:
    """(n,): the largest of all tests of frames (t, n, 2), over its limit; neighbours are trusted points (n,) alone."""
    some = frames[_spread(len(frames), int(np.clip(WORK // len(points), *FEW_FRAMES)))]
    scores = [_near(points, frames, trusted), _clusters(points, some, trusted)]
    if len(frames) > 2:
        scores.append(_near(points, np.diff(frames, 2, axis=0), trusted))
    return np.asarray(np.max(scores, axis=0))


def _near(points: Array, frames: Array, trusted: Flags) -> Array:
    """(n,): distance from a plane through the nearest trusted points, over the limit; of the worst of frames (t, n, 2)."""
    near = _neighbours(points, trusted, NEAREST)
    distance = from_planes(points, frames, near)
    usual = TO_DEVIATION * _usual(distance, near, trusted, FLOOR * _pitch(points))
    return np.asarray((distance / usual).max(axis=1) / LIMIT)


def from_planes(points: Array, frames: Array, near: Index) -> Array:
    """Distance (n, t), mm, of each value of frames (t, n, 2) from a robust plane through those of its neighbours (n, k), over the reach of that."""
    pitch, distance = _pitch(points), np.empty((len(points), len(frames)))
    for part in _chunks(len(points)):
        design = _plane((points[near[part]] - points[part, None]) / pitch)
        values = _of_neighbours(frames, near[part], part)
        surface = _surface(design, values, np.ones(values.shape[:3]), FLOOR * pitch)
        distance[part] = _length(surface) / _reach(design)
    return distance


def _clusters(points: Array, frames: Array, trusted: Flags) -> Array:
    """(n,): distance from the nearer of plane and quadratic through many trusted points, over the limit; of the worst of frames (t, n, 2)."""
    pitch = _pitch(points)
    near, many = (_neighbours(points, trusted, count) for count in (NEAREST, CLUSTER))
    distance, between = (np.empty((len(points), len(frames))) for _ in range(2))
    for part in _chunks(len(points)):
        x = (points[many[part]] - points[part, None]) / pitch
        values = _of_neighbours(frames, many[part], part)
        start = _least_median(x, values, FLOOR * pitch)
        designs = _plane(x), _quadratic(x)
        flat, curved = (_surface(design, values, start, FLOOR * pitch) for design in designs)
        distance[part] = np.minimum(_length(flat) / _reach(designs[0]), _length(curved) / _reach(designs[1]))
        between[part] = _length(flat - curved)
    curvature = np.maximum(between, np.median(between[near], axis=1))
    usual = TO_DEVIATION * _usual(distance, many, trusted, FLOOR * pitch) + CURVATURE * curvature
    return np.asarray((distance / usual).max(axis=1) / NOISE_LIMIT)


def _pitch(points: Array) -> float:
    return spacing_of(points)


def _neighbours(points: Array, trusted: Flags, count: int) -> Index:
    """(n, count): numbers of the nearest trusted points, without the point itself."""
    index = np.flatnonzero(trusted)
    found = index[cKDTree(points[index]).query(points, k=count + 1)[1]]
    return np.where(trusted[:, None], found[:, 1:], found[:, :-1])


def _of_neighbours(frames: Array, neighbours: Index, part: slice) -> Array:
    """(k, neighbours, t, 2): displacements of neighbours relative to those of the points of a part."""
    own = frames[:, part]
    return np.moveaxis(frames[:, neighbours] - own[:, :, None], 0, 2)


def _usual(distance: Array, neighbours: Index, trusted: Flags, floor: float) -> Array:
    """(n, t): median distance of the neighbours, or of the frame, or the floor."""
    of_frame = np.median(distance[trusted], axis=0)
    return np.maximum(np.maximum(np.median(distance[neighbours], axis=1), of_frame), floor)


def _spread(n: int, most: int = MOST_FRAMES) -> Index:
    """At most so many of n frames, evenly spread, the last among them."""
    return np.unique(np.linspace(n - 1, 0, min(n, most)).round().astype(np.int64))


def _chunks(n: int) -> Iterator[slice]:
    return (slice(start, min(start + CHUNK, n)) for start in range(0, n, CHUNK))


def _length(values: Array) -> Array:
    return np.asarray(np.hypot(values[..., 0], values[..., 1]))


def _plane(x: Array) -> Array:
    """(n, k, 3): 1, x, y at offsets (n, k, 2)."""
    return np.concatenate([np.ones((*x.shape[:2], 1)), x], axis=2)


def _quadratic(x: Array) -> Array:
    """(n, k, 6): the same with x^2, xy, y^2."""
    return np.concatenate([_plane(x), x[..., :1] ** 2, x[..., :1] * x[..., 1:], x[..., 1:] ** 2], axis=2)


def _reach(design: Array) -> Array:
    """(n, 1): root of 1 + leverage of the point itself: a surface that reaches beyond its neighbours, as at an edge, is less certain."""
    inverse = np.linalg.pinv(np.swapaxes(design, 1, 2) @ design)
    return np.asarray(np.sqrt(1 + inverse[:, :1, 0]))


def _least_median(x: Array, values: Array, floor: float) -> Array:
    """Weights (n, k, t) by the plane, among those through three of the neighbours, with the least median distance."""
    count = x.shape[1]
    rng = np.random.default_rng(0)
    design, best = _plane(x), np.full((len(x), 1, values.shape[2]), np.inf)
    kept = np.zeros(values.shape[:3])
    for _ in range(TRIPLES):
        three = rng.choice(count, 3, replace=False)
        a, b = x[:, three[1]] - x[:, three[0]], x[:, three[2]] - x[:, three[0]]
        wide = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) > 0.5
        corners = np.where(wide[:, None, None], design[:, three], np.eye(3))
        slopes = np.linalg.solve(corners, values[:, three].reshape(len(x), 3, -1))
        size = _length(values - (design @ slopes).reshape(values.shape))
        middle = np.median(size, axis=1, keepdims=True)
        better = (middle < best) & wide[:, None, None]
        best, kept = np.where(better, middle, best), np.where(better, size, kept)
    return _biweight(kept, floor)


def _biweight(size: Array, floor: float) -> Array:
    """Weights (n, k, t) of distances (n, k, t), 0 from `TUNING` times their median on."""
    width = TUNING * TO_DEVIATION * np.maximum(np.median(size, axis=1, keepdims=True), floor)
    return np.asarray(np.where(size < width, (1 - (size / width) ** 2) ** 2, 0.0) + 1e-6)


def _surface(design: Array, values: Array, weights: Array, floor: float) -> Array:
    """(n, t, 2): at the point itself, the surface of columns (n, k, p) through values (n, k, t, 2), reweighted from weights (n, k, t)."""
    n, k, p = design.shape
    products = (design[:, :, :, None] * design[:, :, None]).reshape(n, k, p * p)
    for _ in range(ROUNDS):
        turned = np.swapaxes(weights, 1, 2)
        normal = (turned @ products).reshape(n, -1, p, p) + 1e-9 * np.eye(p)
        right = np.stack([(turned * np.swapaxes(values[..., i], 1, 2)) @ design for i in (0, 1)], axis=-1)
        c = np.linalg.solve(normal, right)  # (n, t, p, 2)
        fitted = np.stack([design @ np.swapaxes(c[..., i], 1, 2) for i in (0, 1)], axis=-1)
        weights = _biweight(_length(values - fitted), floor)
    return np.asarray(c[:, :, 0])
