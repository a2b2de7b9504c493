"""True edges that no camera sees, in a test: points on them are added, and what is measured is continued to them.

In: points that are left (`points.Kept`), edges. Out: the same with the rims.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibrate.data.experiment import LoadedBoundary
from calibrate.data.points import Kept
from calibrate.data.triangulation import boundary_edges, boundary_nodes
from calibrate.errors import ConfigError
from meshes.errors import MeshDataError
from meshes.measured.round_openings import fitted_hole, is_staircase
from meshes.measured.unseen_rims import (
    NEAR,
    Rims,
    distance_beyond,
    furthest,
    openings,
    places_around,
    with_rims,
)
from meshes.mesh import spacing_of
from meshes.shapes import Arc, Ellipse, Rim, Segment, signed_distance

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
SEEN = 0.1  # distances of the points, within which all beside a rim are on it: then the camera sees it
FAR = 2.0  # of them, over which what is continued is uncertain
OFF_CENTRE = 0.5  # of them, between the middle of a hole and that of the one that the points suggest
ON_GRIP = 0.25  # of them, that an end of a rim is off the line of a grip's nodes


@dataclass(frozen=True)
class ContinuedRim:
    """rim: a true edge; fitted: to the points, and not given; points: how many it has; furthest: distance, mm, from it to the nearest point, at most; beyond: points that
    were left out where nothing should be; is_far: over so many distances of the points that they are uncertain; elsewhere: the hole that the points suggest, where its middle is another."""

    rim: Rim
    fitted: bool
    points: int
    furthest: float
    beyond: int
    is_far: bool
    elsewhere: Ellipse | None

    def to_dict(self) -> dict[str, Any]:
        """For a provenance, mm and degrees."""
        told = {"fitted": self.fitted, "points": self.points, "furthest_mm": self.furthest, "beyond": self.beyond}
        if isinstance(self.rim, Segment):
            return {"start": list(self.rim.start), "end": list(self.rim.end), **told}
        e = self.rim
        ends = {"from_deg": np.degrees(e.first), "to_deg": np.degrees(e.last)} if isinstance(e, Arc) else {}
        shape = {"centre": [e.x, e.y], "diameters": [2 * e.a, 2 * e.b], "angle_deg": float(np.degrees(e.angle))}
        return {**shape, **ends, **told}


@dataclass(frozen=True, eq=False)
class WithRims:
    """kept: with points on the rims after those that are left; its indices are those of the latter. continued (r, k): see `Experiment.continued`; None: no rim was added.
    left_open: see `_left_open`."""

    kept: Kept
    continued: sp.csr_array | None
    rims: tuple[ContinuedRim, ...]
    left_open: tuple[tuple[float, float], ...] = ()

    def with_continued(self, values: Array) -> Array:
        """Values (..., n) at the points before to those with the rims (..., k + r)."""
        measured = values[..., self.kept.indices]
        return measured if self.continued is None else np.concatenate([measured, measured @ self.continued.T], axis=-1)


def with_continued_rims(kept: Kept, given: Sequence[Rim], fit: bool) -> WithRims:
    """given: true edges, mm; fit: whether other openings that are free and a staircase get the largest circle or ellipse between their points.

    Raises `ConfigError` for an edge that is not where the points leave one.
    """
    if not given and not fit:
        return WithRims(kept, None, ())
    pitch = spacing_of(kept.points)
    try:
        rims = [rim for rim in given if not _is_seen(kept, rim, pitch)]
        found = _joined(kept, rims) if rims else None
    except MeshDataError as error:
        raise ConfigError(f"[edges] {error}") from error
    holes = _fitted_holes(kept, rims, pitch) if fit else []
    if not rims and not holes:
        return WithRims(kept, None, (), _left_open(kept, kept.points, kept.triangles) if fit else ())
    found = _joined(kept, [*rims, *holes]) if holes or found is None else found
    told = []
    for rim, size in zip([*rims, *holes], found.sizes, strict=True):
        beyond, far = distance_beyond(rim, kept.points), furthest(rim, kept.points)
        is_far = far > FAR * pitch
        told.append(
            ContinuedRim(
                rim, rim in holes, size, far, int((beyond < -SEEN * pitch).sum()), is_far, _elsewhere(kept, rim, pitch)
            )
        )
    left = _left_open(kept, found.points, found.triangles) if fit else ()
    return WithRims(_grown(kept, found, ON_GRIP * pitch), found.continued, tuple(told), left)


def _left_open(kept: Kept, points: Array, triangles: Indices) -> tuple[tuple[float, float], ...]:
    """Middles (x, y), mm, of openings among points (n, 2) that are free, end in a staircase and were neither given nor fitted."""
    free = kept.points[kept.free_nodes]
    places = [points[opening] for opening in openings(points, triangles)]
    staircases = [p for p in places if len(free) and is_staircase(p) and cKDTree(free).query(p)[0].max() == 0]
    return tuple((float(x), float(y)) for x, y in (p.mean(axis=0) for p in staircases))


def _elsewhere(kept: Kept, rim: Rim, pitch: float) -> Ellipse | None:
    """The hole that the points suggest, where its middle is another than that of one that was given."""
    places = places_around(kept.points, kept.triangles, rim) if rim.closed else np.zeros((0, 2))
    hole = fitted_hole(places, pitch) if len(places) and is_staircase(places) else None
    return hole if hole is not None and np.hypot(hole.x - rim.x, hole.y - rim.y) > OFF_CENTRE * pitch else None


def _is_seen(kept: Kept, rim: Rim, pitch: float) -> bool:
    """Whether the points beside a rim are on it. Raises `MeshDataError` where there are none."""
    beyond = distance_beyond(rim, places_around(kept.points, kept.triangles, rim))
    return bool(np.abs(beyond).max() < SEEN * pitch)


def _joined(kept: Kept, rims: Sequence[Rim]) -> Rims:
    """Raises `MeshDataError` where a rim cannot be."""
    ends = np.concatenate([np.zeros((0, 2)), *(rim.along(np.array([0.0, 1.0])) for rim in rims if not rim.closed)])
    staying = (np.setdiff1d(b.nodes, _last_of_grip(kept.points, b, ends)) for b in kept.loaded)
    gripped = np.concatenate([np.zeros(0, np.int64), *staying])
    return with_rims(kept.points, kept.triangles, rims, gripped)


def _last_of_grip(points: Array, boundary: LoadedBoundary, ends: Array) -> Indices:
    """Nodes of a grip that give way to the end of a rim (k, 2) which continues its line, as other points do that are so near to a rim: that end is gripped in their place."""
    places, pitch = points[boundary.nodes], spacing_of(points)
    across = int(np.ptp(places, axis=0).argmin())
    along = places[:, 1 - across]
    found = np.zeros(len(places), bool)
    for end in ends:
        is_beyond = not along.min() < end[1 - across] < along.max()
        near = np.linalg.norm(places - end, axis=1) < NEAR * pitch
        found |= is_beyond & near & (np.abs(places[:, across] - end[across]) <= ON_GRIP * pitch)
    return np.asarray(boundary.nodes[found])


def _fitted_holes(kept: Kept, given: Sequence[Rim], pitch: float) -> list[Ellipse]:
    """Of openings that are free, a staircase, and none of those given; that can be joined to the points beside those given."""
    found: list[Ellipse] = []
    for opening in openings(kept.points, kept.triangles):
        hole = _fitted(kept, opening, given, pitch)
        with suppress(MeshDataError):
            if hole is not None and _joined(kept, [*given, *found, hole]):
                found.append(hole)
    return found


def _fitted(kept: Kept, opening: Indices, given: Sequence[Rim], pitch: float) -> Ellipse | None:
    """Of an opening that is free, a staircase, and none of those given."""
    places = kept.points[opening]
    is_given = any(rim.closed and signed_distance(np.array([[rim.x, rim.y]]), places)[0] > 0 for rim in given)
    if is_given or not np.isin(opening, kept.free_nodes).all() or not is_staircase(places):
        return None
    return fitted_hole(places, pitch)


def _grown(kept: Kept, found: Rims, off: float) -> Kept:
    """In the numbers of the grown triangulation. off: see `_gripped_ends`."""
    number = np.full(len(kept.points), -1)
    number[found.kept] = np.arange(len(found.kept))
    displacements = kept.displacements[:, found.kept]
    continued = np.stack([found.continued @ u for u in displacements])
    boundaries = [replace(b, nodes=number[np.intersect1d(b.nodes, found.kept)]) for b in kept.loaded]
    loaded = tuple(
        replace(b, nodes=np.union1d(b.nodes, _gripped_ends(b, found, len(found.kept), off))) for b in boundaries
    )
    free = number[kept.free_nodes]
    still_free = np.intersect1d(free[free >= 0], boundary_nodes(found.triangles))
    on_rims = np.arange(len(found.kept), len(found.points))
    held = np.concatenate([np.zeros(0, np.int64), *(b.nodes for b in loaded)])
    return Kept(
        kept.indices[found.kept],
        kept.lost,
        found.points,
        found.triangles,
        np.concatenate([displacements, continued], axis=1),
        loaded,
        np.setdiff1d(np.union1d(still_free, on_rims), held),
    )


def _gripped_ends(boundary: LoadedBoundary, found: Rims, n: int, off: float) -> Indices:
    """Points of rims, from number n on, that continue the line of a grip: joined to one of its nodes along the outline, and at most `off` mm beside it."""
    edges = boundary_edges(found.triangles)[0]
    pairs = np.concatenate([edges, edges[:, ::-1]])
    pairs = pairs[np.isin(pairs[:, 0], boundary.nodes) & (pairs[:, 1] >= n)]
    across = int(np.ptp(found.points[boundary.nodes], axis=0).argmin())
    step = np.abs(np.diff(found.points[pairs][..., across], axis=1)[:, 0])
    return np.asarray(pairs[step <= off, 1])
