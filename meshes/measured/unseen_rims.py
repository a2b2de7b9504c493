"""Rims of round holes beyond the points that a camera sees: a triangulation that ends in a staircase of points in, one that ends on the rim out.

A correlation of pictures has no points nearer to a hole than half its subset, and on a grid the outermost of them make a staircase, whose polygon is neither
free of traction nor evenly far from the rim. New points on the rim close the gap. Values are continued to them by quadratics, fitted to the nearest points with
weights that fall with the distance (moving least squares; Lancaster, Salkauskas 1981, Math. Comp. 37).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial import Delaunay, cKDTree

from meshes.errors import MeshDataError
from meshes.mesh import boundary_edges, within
from meshes.shapes import Ellipse, Rim, polygon_area, signed_distance

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
ALONG = 0.55  # distances of the measured points, between points on a rim
NEAR = 0.3  # of them, within which a point gives way to the rim: more than half of `ALONG`, so that every edge of the rim is one of a Delaunay triangle
INSIDE = 1.0  # of them, that a point may be inside a hole
CLOSE, FURTHEST = (
    0.8,
    1.5,
)  # of them, that nine of ten points around an opening, and all, are beyond an ellipse fitted to it
RAGGED = 0.5  # of the mean turn of a polygon, that a turn differs from those beside it in a staircase
FINE = 720  # places on a rim, to which distances are measured
NEAREST = 12  # points of a quadratic, at least
REACH = 1.5  # distances of the points behind the nearest one, from which they come
AROUND = 60  # points that are looked at
FALL = 2.0  # exponent of the weight at the furthest point
WIDEST, THIN = (
    2.6,
    0.05,
)  # of them, the longest edge of a triangle beside an open rim; its least area, over that edge squared


@dataclass(frozen=True, eq=False)
class Rims:
    """kept (k,): old numbers of the points that stay. points (k + r, 2), mm: those on the rims last; triangles (m, 3); continued (r, k): values there from those at the points
    kept; sizes: how many points each rim has."""

    kept: Indices
    points: Array
    triangles: Indices
    continued: sp.csr_array
    sizes: tuple[int, ...]


def with_rims(points: Array, triangles: Indices, rims: Sequence[Rim], fixed: Indices) -> Rims:
    """points (n, 2), mm, anticlockwise triangles (m, 3) with an opening around each of the holes; an `Arc` or `Segment` is at the outline. fixed (f,): points that stay, wherever a rim is.

    Raises `MeshDataError` for a hole without an opening around its middle, an open rim without points beside it, points far inside, and a rim that cannot be joined to the points.
    """
    pitch = spacing(points)
    going = np.zeros(len(points), bool)
    for rim in rims:
        beyond = distance_beyond(rim, points)
        _refuse_inside(rim, points, beyond, pitch)
        going |= beyond < NEAR * pitch
    going[fixed] = False
    kept = np.flatnonzero(~going)
    all_places = [_away(on_rim(rim, ALONG * pitch), points[fixed], NEAR * pitch) for rim in rims]
    grown = np.concatenate([points[kept], *all_places])
    continued = sp.vstack(
        [_continued(points[kept], places, rim, pitch) for places, rim in zip(all_places, rims, strict=True)]
    )
    ends = len(kept) + np.cumsum([0, *map(len, all_places)])
    numbers = [np.arange(a, b) for a, b in pairwise(ends.tolist())]
    new = _triangulated(grown, (points, triangles), rims, numbers)
    for rim, places in zip(rims, numbers, strict=True):
        if not _is_joined(new, places, not rim.closed):
            raise _not_joined(rim)
    if len(openings(grown, new)) != len(openings(points, triangles)):
        raise _not_joined(*rims)
    return Rims(kept, grown, new, sp.csr_array(continued), tuple(map(len, all_places)))


def _away(places: Array, fixed: Array, least: float) -> Array:
    """Points of a rim (r, 2) that are not at fixed ones (f, 2)."""
    return places if not len(fixed) else places[cKDTree(fixed).query(places)[0] > least]


def _is_joined(triangles: Indices, places: Indices, is_open: bool) -> bool:
    """Whether the way along a rim (r,) is one along the outline of triangles."""
    edges = {frozenset(edge) for edge in boundary_edges(triangles, "triangle")[0].tolist()}
    way = [frozenset(edge) for edge in zip(places.tolist(), np.roll(places, -1).tolist(), strict=True)]
    return all(edge in edges for edge in (way[:-1] if is_open else way))


def _not_joined(*rims: Rim) -> MeshDataError:
    places = ", ".join(f"({rim.x:.4g}, {rim.y:.4g})" for rim in rims)
    return MeshDataError(
        f"the rim around {places} mm cannot be joined to the measured points: points are missing beside it, or it is another one"
    )


def _refuse_inside(rim: Rim, points: Array, beyond: Array, pitch: float) -> None:
    """Points far beyond an edge show that it is elsewhere."""
    if beyond.min() < -INSIDE * pitch:
        x, y = points[beyond.argmin()]
        raise MeshDataError(
            f"the {'hole' if rim.closed else 'edge'} at ({rim.x:.4g}, {rim.y:.4g}) mm: {int((beyond < -INSIDE * pitch).sum())} measured points lie where nothing is left, the furthest at ({x:.4g}, {y:.4g}) mm, "
            f"{-beyond.min():.2g} mm beyond; it is smaller, or elsewhere"
        )


def _triangulated(
    grown: Array, old: tuple[Array, Indices], rims: Sequence[Rim], all_places: Sequence[Indices]
) -> Indices:
    """Delaunay triangles of the grown points inside the old ones, between an opening and its hole, or beside an open rim."""
    points, triangles = old
    new = Delaunay(grown).simplices.astype(np.int64)
    a, b, c = (grown[new[:, k]] for k in range(3))
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    new[twice < 0] = new[twice < 0][:, ::-1]
    centres, pitch = grown[new].mean(axis=1), spacing(points)
    longest = np.max([np.linalg.norm(one - other, axis=1) for one, other in ((a, b), (b, c), (c, a))], axis=0)
    is_compact = (longest < WIDEST * pitch) & (np.abs(twice) > 2 * THIN * longest**2)
    inside = within(points, triangles, centres)
    for rim, places in zip(rims, all_places, strict=True):
        if not rim.closed:
            inside |= np.isin(new, places).any(axis=1) & is_compact
        else:
            inside |= signed_distance(centres, points[_opening_at(points, triangles, rim)]) > 0
    for rim in rims:
        inside &= ~rim.cuts(centres)
    return np.asarray(new[inside & (np.abs(twice) > 1e-9 * pitch**2)])


def _continued(points: Array, places: Array, rim: Rim, pitch: float) -> sp.csr_array:
    """(r, n): values at points to those at the rim."""
    distances, nearest = cKDTree(points).query(places, k=min(AROUND, len(points)))
    rows, columns, values = [], [], []
    for k, place in enumerate(places):
        on_this_side = ~rim.cuts(0.5001 * points[nearest[k]] + 0.4999 * place)
        distance, near = distances[k][on_this_side], nearest[k][on_this_side]
        size = max(distance[0] + REACH * pitch, distance[min(NEAREST, len(near)) - 1])
        near, distance = near[distance <= size], distance[distance <= size]
        x, y = ((points[near] - place) / size).T
        weights = np.exp(-FALL * (distance / size) ** 2)
        quadratic = np.column_stack([np.ones_like(x), x, y, x**2, x * y, y**2])
        values.append(np.linalg.pinv(quadratic * weights[:, None])[0] * weights)
        rows.append(np.full(len(near), k))
        columns.append(near)
    where = np.concatenate(rows), np.concatenate(columns)
    return sp.csr_array((np.concatenate(values), where), shape=(len(places), len(points)))


def is_staircase(polygon: Array) -> bool:
    """Whether a closed polygon (k, 2) turns here and there, as the points of a grid around a round hole do, and not everywhere alike, as points on its rim do."""
    along = np.roll(polygon, -1, axis=0) - polygon
    after = np.roll(along, -1, axis=0)
    turns = np.arctan2(along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0], (along * after).sum(axis=1))
    beside = (np.roll(turns, 1) + np.roll(turns, -1)) / 2
    return float(np.abs(turns - beside).mean()) > RAGGED * 2 * np.pi / len(turns)


def fitted_hole(opening: Array, pitch: float) -> Ellipse | None:
    """The largest circle between the points (k, 2), mm, around an opening that a grid of distance `pitch` left of a round hole, or the largest ellipse; None where neither
    comes near enough to all of them."""
    middle = opening.mean(axis=0)
    radius = float(np.linalg.norm(opening - middle, axis=1).mean())
    circle = minimize(lambda c: -np.linalg.norm(opening - c, axis=1).min(), middle, method="Nelder-Mead").x
    found = Ellipse(*circle.tolist(), *2 * [float(np.linalg.norm(opening - circle, axis=1).min())])
    if _is_close(found, opening, pitch):
        return found
    for angle in np.arange(4) * np.pi / 4:
        start = np.array([*middle, np.log(radius), 0.3, angle])
        best = minimize(lambda p: -_largest(p, opening).area, start, method="Nelder-Mead", options={"maxiter": 4000})
        found = _largest(best.x, opening)
        if _is_close(found, opening, pitch):
            return found
    return None


def _largest(shape: Array, opening: Array) -> Ellipse:
    """The ellipse of a shape (x, y, logarithm of the size, logarithm of the ratio, angle) between the points."""
    x, y, size, ratio, angle = shape.tolist()
    a, b, angle = np.exp(size + abs(ratio) / 2), np.exp(size - abs(ratio) / 2), angle + (ratio < 0) * np.pi / 2
    level = float(Ellipse(x, y, a, b, angle).level(opening).min())
    return Ellipse(x, y, float(a * level), float(b * level), (angle + np.pi / 2) % np.pi - np.pi / 2)


def _is_close(hole: Ellipse, opening: Array, pitch: float) -> bool:
    beyond = distance_beyond(hole, opening)
    near = float(np.quantile(beyond, 0.9)) < CLOSE * pitch and float(beyond.max()) < FURTHEST * pitch
    return near and hole.b > pitch


def on_rim(rim: Rim, step: float) -> Array:
    """Points (r, 2), mm, evenly along a rim, at most `step` mm from each other; both ends of an open one among them."""
    fine = rim.along(np.linspace(0, 1, FINE + 1))
    lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1)))
    count = max(8 if rim.closed else 1, int(np.ceil(lengths[-1] / step)))
    shares = np.interp(np.linspace(0, lengths[-1], count + 1), lengths, np.linspace(0, 1, FINE + 1))
    return rim.along(shares[:-1] if rim.closed else shares)


def distance_beyond(rim: Rim, points: Array) -> Array:
    """How far outside of a rim points (n, 2) are, mm; negative where nothing is left."""
    distance = cKDTree(rim.rim(FINE)).query(points)[0]
    return np.where(rim.cuts(points), -distance, distance)


def places_around(points: Array, triangles: Indices, rim: Rim) -> Array:
    """Points (k, 2), mm, of the outline beside a rim. Raises `MeshDataError` where there are none."""
    if rim.closed:
        return np.asarray(points[_opening_at(points, triangles, rim)])
    outline = points[np.unique(boundary_edges(triangles, "triangle")[0])]
    distance, nearest = cKDTree(outline).query(rim.rim(FINE))
    if distance.min() > WIDEST * spacing(points):
        raise MeshDataError(
            f"the edge around ({rim.x:.4g}, {rim.y:.4g}) mm: no edge of the measured region is beside it; its place is in mm of the imported frame, y up, angles are "
            "anticlockwise from x"
        )
    return np.asarray(outline[np.unique(nearest)])


def openings(points: Array, triangles: Indices) -> list[Indices]:
    """Nodes of every closed polygon inside the outline, anticlockwise."""
    edges, _ = boundary_edges(triangles, "triangle")
    before: dict[int, list[int]] = {}
    for start, end in edges.tolist():
        before.setdefault(end, []).append(start)
    found = []
    while before:
        first = next(iter(before))
        loop, node = [first], before[first].pop()
        while node != first:
            loop.append(node)
            node = before[node].pop()
        before = {node: starts for node, starts in before.items() if starts}
        found.append(np.array(loop))
    return [loop for loop in found if polygon_area(points[loop]) > 0]


def _opening_at(points: Array, triangles: Indices, rim: Rim) -> Indices:
    """The opening around the middle of a hole. Raises `MeshDataError` where there is none."""
    middle = np.array([[rim.x, rim.y]])
    for opening in openings(points, triangles):
        if signed_distance(middle, points[opening])[0] > 0:
            return opening
    raise MeshDataError(
        f"the hole at ({rim.x:.4g}, {rim.y:.4g}) mm: no opening in the measured region is around it; its centre is in mm of the imported frame, y up"
    )


def spacing(points: Array) -> float:
    """Median distance of points (n, 2) to the nearest other one, mm."""
    return float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))
