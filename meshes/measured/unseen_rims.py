"""Edges beyond the points that a camera sees: a triangulation that ends in a staircase of points in, one that ends on the true edges out.

A correlation of pictures has no points nearer to an edge than half its subset, and on a grid the outermost of them make a staircase, whose polygon is neither
free of traction nor evenly far from a round edge. New points on the edge close the gap. Values are continued to them by quadratics, fitted to the nearest points with
weights that fall with the distance (moving least squares; Lancaster, Salkauskas 1981, Math. Comp. 37).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import Delaunay, cKDTree

from meshes.errors import MeshDataError
from meshes.mesh import boundary_edges, signed_areas, spacing_of, within
from meshes.shapes import Rim, polygon_area, signed_distance

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
# in distances of the measured points:
ALONG = 0.55  # between points on a rim
NEAR = 0.3  # within which a point gives way to the rim: more than half of `ALONG`, so that every edge of the rim is one of a Delaunay triangle
INSIDE = 1.0  # that a point may be beyond an edge
FURTHEST = 3.0  # over which values are continued
REACH = 1.5  # behind the nearest point, from which values come, and as much more as that is further than one
JOINED = 1.6  # longest edge of a triangle beside an open rim, beyond the distance of rim and points
# others:
FINE = 720  # places on a rim, to which distances are measured
NEAREST, AROUND = 12, 80  # points of a quadratic, at least; points that are looked at
FALL = 2.0  # exponent of the weight at the furthest point
THIN = 0.03  # least area of a triangle beside an open rim, over its longest edge squared
SHOWN = 12  # openings that an error lists
FLAT = 1e-9  # of the same, where points are in a line


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
    pitch = spacing_of(points)
    going = np.zeros(len(points), bool)
    for rim in rims:
        beyond = distance_beyond(rim, points)
        _refuse_inside(rim, points, beyond, pitch)
        _refuse_far(rim, points, pitch)
        going |= beyond < NEAR * pitch
    going[fixed] = False
    kept = np.flatnonzero(~going)
    taken, all_places = points[fixed], []
    for rim in rims:
        all_places.append(_away(on_rim(rim, ALONG * pitch), taken, NEAR * pitch))
        if not len(all_places[-1]):
            raise MeshDataError(f"the edge at ({rim.x:.4g}, {rim.y:.4g}) mm is given twice, or lies on a grip")
        taken = np.concatenate([taken, all_places[-1]])
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
    """Points of a rim (r, 2) that are not at others (f, 2)."""
    return places if not len(fixed) else places[cKDTree(fixed).query(places)[0] > least]


def _is_joined(triangles: Indices, places: Indices, is_open: bool) -> bool:
    """Whether the way along a rim (r,) is one along the outline of triangles."""
    edges = {frozenset(edge) for edge in boundary_edges(triangles, "triangle")[0].tolist()}
    way = [frozenset(edge) for edge in zip(places.tolist(), np.roll(places, -1).tolist(), strict=True)]
    return all(edge in edges for edge in (way[:-1] if is_open else way))


def _not_joined(*rims: Rim) -> MeshDataError:
    places = ", ".join(f"({rim.x:.4g}, {rim.y:.4g})" for rim in rims)
    return MeshDataError(
        f"the rim around {places} mm cannot be joined to the measured points. Either points are missing beside it, or another rim or a grip is nearer than two distances of the points, "
        "or the end of an arc is beside a grip: let it end before"
    )


def _refuse_inside(rim: Rim, points: Array, beyond: Array, pitch: float) -> None:
    """Points far beyond an edge show that it is elsewhere."""
    if beyond.min() < -INSIDE * pitch:
        x, y = points[beyond.argmin()]
        raise MeshDataError(
            f"the {'hole' if rim.closed else 'edge'} at ({rim.x:.4g}, {rim.y:.4g}) mm: {int((beyond < -INSIDE * pitch).sum())} measured points lie where nothing is left, the furthest at ({x:.4g}, {y:.4g}) mm, "
            f"{-beyond.min():.2g} mm beyond; it is smaller, or elsewhere"
        )


def _refuse_far(rim: Rim, points: Array, pitch: float) -> None:
    """Values are not continued as far as one likes."""
    far = furthest(rim, points)
    if far > FURTHEST * pitch:
        slip = (
            "Is the diameter meant, and not the radius?"
            if rim.closed
            else "Give only the part beside which there are points."
        )
        raise MeshDataError(
            f"the {'hole' if rim.closed else 'edge'} at ({rim.x:.4g}, {rim.y:.4g}) mm is up to {far:.3g} mm from the nearest point, {far / pitch:.2g} distances of the points; fields are continued "
            f"over {FURTHEST:g} at most. {slip} Otherwise correlate nearer to the edge"
        )


def furthest(rim: Rim, points: Array) -> float:
    """Largest distance, mm, from a rim to the nearest of points (n, 2)."""
    return float(cKDTree(points).query(rim.rim())[0].max())


def _triangulated(
    grown: Array, old: tuple[Array, Indices], rims: Sequence[Rim], all_places: Sequence[Indices]
) -> Indices:
    """Delaunay triangles of the grown points inside the old ones, between an opening and its hole, or beside an open rim."""
    points, triangles = old
    new = Delaunay(grown).simplices.astype(np.int64)
    areas = signed_areas(grown, new)
    new[areas < 0] = new[areas < 0][:, ::-1]
    corners = grown[new]
    centres, pitch = corners.mean(axis=1), spacing_of(points)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    shape = np.abs(areas) / longest**2
    inside = within(points, triangles, centres, FLAT)
    for rim, places in zip(rims, all_places, strict=True):
        if rim.closed:
            inside |= signed_distance(centres, points[_opening_at(points, triangles, rim)]) > 0
        else:
            widest = furthest(rim, points) + JOINED * pitch
            inside |= np.isin(new, places).any(axis=1) & (shape > THIN) & (longest < widest)
    for rim in rims:
        inside &= ~rim.cuts(centres)
    return np.asarray(new[inside & (shape > 10 * FLAT)])


def _continued(points: Array, places: Array, rim: Rim, pitch: float) -> sp.csr_array:
    """(r, n): values at points to those at the rim."""
    distances, nearest = cKDTree(points).query(places, k=min(AROUND, len(points)))
    rows, columns, values = [], [], []
    for k, place in enumerate(places):
        on_this_side = ~rim.cuts(0.5001 * points[nearest[k]] + 0.4999 * place)
        distance, near = distances[k][on_this_side], nearest[k][on_this_side]
        size = distance[0] + REACH * pitch + max(0.0, distance[0] - pitch)
        size = max(size, distance[min(NEAREST, len(near)) - 1])
        near, distance = near[distance <= size], distance[distance <= size]
        x, y = ((points[near] - place) / size).T
        weights = np.exp(-FALL * (distance / size) ** 2)
        quadratic = np.column_stack([np.ones_like(x), x, y, x**2, x * y, y**2])
        values.append(np.linalg.pinv(quadratic * weights[:, None])[0] * weights)
        rows.append(np.full(len(near), k))
        columns.append(near)
    where = np.concatenate(rows), np.concatenate(columns)
    return sp.csr_array((np.concatenate(values), where), shape=(len(places), len(points)))


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
    if distance.min() > FURTHEST * spacing_of(points):
        raise MeshDataError(
            f"the edge around ({rim.x:.4g}, {rim.y:.4g}) mm: no edge of the measured region is within {FURTHEST:g} distances of the points, its nearest {distance.min():.3g} mm away; "
            f"{_frame(points)}; angles are anticlockwise from x"
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
    places = [points[opening] for opening in openings(points, triangles)]
    found = [
        f"({x:.4g}, {y:.4g}), {w:.3g} x {h:.3g} mm"
        for x, y, w, h in ((*p.mean(axis=0), *np.ptp(p, axis=0)) for p in places)
    ]
    listed = "openings are at " + "; ".join(found[:SHOWN]) if found else "there is none"
    raise MeshDataError(
        f"the hole at ({rim.x:.4g}, {rim.y:.4g}) mm: no opening in the measured region is around it; {listed}; {_frame(points)}. One that is joined to the outline is an arc"
    )


def _frame(points: Array) -> str:
    (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
    return f"the measured region is from ({x0:.4g}, {y0:.4g}) to ({x1:.4g}, {y1:.4g}) mm, y up"
