"""Failed points of a measured field: left out, and the gap closed by a new triangulation.

In: points, triangles and displacements with failed points (not finite, or listed). Out: `Kept`, the same arrays
without them, triangulated anew (Delaunay) inside the original outline; holes stay holes.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

from calibrate import errors
from calibrate.data.experiment import LoadedBoundary
from calibrate.data.triangulation import boundary_nodes, signed_areas
from meshes.mesh import within

Array = NDArray[np.float64]
Index = NDArray[np.int64]
MAX_LOST, MAX_AREA_CHANGE = 0.2, 0.1


@dataclass(frozen=True)
class Kept:
    """What is left. indices (n_kept,): old node numbers; lost: old numbers of the nodes left out.

    points (n_kept, 2) mm, triangles (m, 3), displacements (n_increments, n_kept, 2) mm; loaded and free_nodes in
    new numbers.
    """

    indices: Index
    lost: Index
    points: Array
    triangles: Index
    displacements: Array
    loaded: tuple[LoadedBoundary, ...] = ()
    free_nodes: Index = field(default_factory=lambda: np.zeros(0, np.int64))


def failed_points(displacements: Array) -> Index:
    """Nodes with a displacement that is not finite in any increment of (n_increments, n, 2)."""
    return np.flatnonzero(~np.isfinite(displacements).all(axis=(0, 2)))


def drop_points(
    points: Array,
    triangles: Index,
    displacements: Array,
    loaded: tuple[LoadedBoundary, ...] = (),
    free_nodes: Index | None = None,
    failed: Index | None = None,
) -> Kept:
    """Leave failed points out and triangulate the rest inside the original outline.

    points (n, 2) mm, triangles (m, 3), displacements (n_increments, n, 2) mm. failed: node numbers; by default
    those whose displacements are not finite. Without failed points everything is returned as it came.
    Raises `LostPointsError` when more than 20 % are lost, when one lies on a loaded edge, or when what is left
    does not cover the specimen.
    """
    free = np.zeros(0, np.int64) if free_nodes is None else np.asarray(free_nodes, np.int64)
    lost = np.unique(failed_points(displacements) if failed is None else np.asarray(failed, np.int64))
    if lost.size == 0:
        return Kept(np.arange(len(points)), lost, points, triangles, displacements, loaded, free)
    _refuse(points, lost, loaded)
    indices = np.setdiff1d(np.arange(len(points)), lost)
    new = _triangulate(points, triangles, indices)
    used = np.unique(new)
    if used.size < indices.size:  # points that lost all their neighbours
        lost = np.setdiff1d(np.arange(len(points)), indices[used])
        _refuse(points, lost, loaded)
        indices, new = indices[used], np.searchsorted(used, new)
    number = np.full(len(points), -1)
    number[indices] = np.arange(indices.size)
    boundary = boundary_nodes(new)
    kept_free = number[np.intersect1d(free, indices)]
    return Kept(
        indices,
        lost,
        points[indices],
        new,
        displacements[:, indices],
        tuple(replace(b, nodes=number[b.nodes]) for b in loaded),
        np.intersect1d(kept_free, boundary),
    )


def _refuse(points: Array, lost: Index, loaded: tuple[LoadedBoundary, ...]) -> None:
    n = len(points)
    if lost.size > MAX_LOST * n:
        raise errors.LostPointsError(
            f"{lost.size} of {n} points failed ({100 * lost.size / n:.0f} %, at most {100 * MAX_LOST:.0f} % can be "
            "bridged); leave out the worst frames (frames.list in a column map, --frames for a sheet), or measure again"
        )
    for boundary in loaded:
        hit = np.intersect1d(boundary.nodes, lost)
        if hit.size:
            raise errors.LostPointsError(
                f"{hit.size} failed points lie on the loaded edge '{boundary.name}', the first at ({points[hit[0], 0]:.4g}, "
                f"{points[hit[0], 1]:.4g}) mm; take a row further inside (edges.drop_points in a column map, --drop-rows for a sheet), or "
                "leave out the frames in which they fail (frames.list, --frames)"
            )


def _triangulate(points: Array, triangles: Index, indices: Index) -> Index:
    """Delaunay triangles (m, 3) of points[indices], in numbers of `indices`, within the old triangulation."""
    kept = points[indices]
    try:
        new = Delaunay(kept).simplices.astype(np.int64)
    except QhullError as error:
        raise errors.LostPointsError("the points that are left cannot be triangulated: they lie on a line") from error
    area = signed_areas(kept, new)
    new[area < 0] = new[area < 0][:, ::-1]
    centres = kept[new].mean(axis=1)
    corners = kept[new] + 0.1 * (centres[:, None] - kept[new])
    inside = within(points, triangles, centres) & (
        within(points, triangles, corners.reshape(-1, 2)).reshape(-1, 3).sum(axis=1) >= 2
    )
    longest = max(np.linalg.norm(kept[new] - np.roll(kept[new], 1, axis=1), axis=2).max(axis=1).max(), 1e-300)
    area = np.abs(area)
    thin = area < 1e-6 * longest**2
    new = new[inside & ~thin]
    before = float(np.abs(signed_areas(points, triangles)).sum())
    after = float(signed_areas(kept, new).sum()) if len(new) else 0.0
    if abs(after - before) > MAX_AREA_CHANGE * before:
        raise errors.LostPointsError(
            f"without its failed points the specimen covers {100 * after / before:.0f} % of its area; "
            "too many fail at its edges"
        )
    return new
