"""A strip of triangles along the free edges of a triangulation: what the camera does not see of a specimen.

In: points (n, 2), mm, anticlockwise triangles (m, 3), its outline, and the width of the strip. Out: `Strip`, the same triangulation grown by it; the first n points
are the old ones. A new point lies on the bisector of its edges; where a free edge meets another one, on the continuation of that, unless it goes along.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshes.errors import MeshDataError
from meshes.mesh import signed_areas

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
NARROWER, SHORTER = 0.7, 3  # factor on the width where it folds, as at the corners of a staircase of points; how often
SHARPEST = 0.5  # cosine between the way to a new point and the normal of its edge, below which it is another way


@dataclass(frozen=True, eq=False)
class Strip:
    """points (n + k, 2), triangles (m + 2 e, 3); parents (k,): the old point of each new one; edges (e, 2): free ones of the grown outline; ends (q, 2): edges of it
    from an old point to its new one; beside (q,): number of the other edge that each goes on from."""

    points: Array
    triangles: Indices
    parents: Indices
    edges: Indices
    ends: Indices
    beside: Indices


def with_strip(points: Array, triangles: Indices, free: Indices, others: Indices, width: float) -> Strip:
    """free (e, 2), others (o, 2): edges of the outline, the body on their left; width: of the strip beside the free ones, mm.

    Raises `MeshDataError` where a strip so wide folds.
    """
    n, parents = len(points), np.unique(free)
    along = points[free[:, 1]] - points[free[:, 0]]
    normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    into, out = (np.zeros((n, 2)) for _ in range(2))
    out[free[:, 0]], into[free[:, 1]] = normals, normals
    inner = into[parents].any(axis=1) & out[parents].any(axis=1)
    way = into[parents] + out[parents]  # of an end: the one normal it has
    beside = np.array([_beside(node, others) for node in parents[~inner].tolist()], np.int64)
    from_inside = points[parents[~inner]] - points[others[beside].sum(axis=1) - parents[~inner]]
    cosine = (from_inside * way[~inner]).sum(axis=1) / np.linalg.norm(from_inside, axis=1)
    steps = width * way / np.maximum((way * (into + out)[parents]).sum(axis=1) / 2, SHARPEST)[:, None]
    goes_on = cosine > SHARPEST
    further = from_inside / (np.linalg.norm(from_inside, axis=1) * np.where(goes_on, cosine, 1.0))[:, None]
    steps[~inner] = width * np.where(goes_on[:, None], further, way[~inner])
    number = np.full(n, -1)
    number[parents] = n + np.arange(len(parents))
    (a, b), (c, d) = free.T, number[free].T
    added = np.concatenate([np.column_stack([c, d, b]), np.column_stack([c, b, a])])
    grown = np.concatenate([points, points[parents] + steps])
    for _ in range(SHORTER):
        narrow = np.isin(number[parents], added[signed_areas(grown, added) <= 0])
        steps[narrow] *= NARROWER
        grown[n:] = points[parents] + steps
    folded = signed_areas(grown, added) <= 0
    if folded.any():
        x, y = grown[added[folded][0]].mean(axis=0)
        raise MeshDataError(f"a strip of {width:.3g} mm beside the measured region folds at ({x:.4g}, {y:.4g}) mm")
    corners = parents[~inner]
    ends = np.column_stack([corners, number[corners]])
    return Strip(grown, np.concatenate([triangles, added]), parents, np.column_stack([c, d]), ends, beside)


def _beside(node: int, others: Indices) -> int:
    """The other edge of the outline at a node."""
    return int(np.flatnonzero((others == node).any(axis=1))[0])
