"""Biquadratic quads of a triangulation: each triangle becomes three quads, so that the outline stays what was measured.

In: points (n, 2), mm, anticlockwise triangles (m, 3), edges of their outline by name, and arcs: edges that are no chords but parabolas. Out: a
`Mesh` of 3 m quads, whose first n nodes are the points; and for every node the points and shares that place it, so that what is known at the points
is carried to the nodes. A triangle with an arc is the quadratic one: its nodes at the barycentric coordinates a, b of the edge's ends move by
4 a b times the rise of the arc.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from meshes.errors import MeshDataError
from meshes.mesh import Mesh, boundary_edges

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
WHOLE = 24  # weights are counted in 24ths, so that a node is the same node whatever triangle it is reached from
PLACES = np.array([(24, 0, 0), (12, 12, 0), (8, 8, 8), (12, 0, 12),  # corners of the quad at the first corner
                   (18, 6, 0), (10, 10, 4), (10, 4, 10), (18, 0, 6), (14, 5, 5)])  # fmt: skip


@dataclass(frozen=True, eq=False)
class SplitMesh:
    """mesh: the quads. interpolation (nodes, n): linear within each triangle, from points to nodes."""

    mesh: Mesh
    interpolation: sp.csr_array


def split(
    points: Array,
    triangles: Indices,
    edges: Mapping[str, Indices],
    finer: int = 0,
    arcs: tuple[Indices, Array] | None = None,
) -> SplitMesh:
    """Quads of a triangulation. edges: boundary name to edges (e, 2) of the outline. finer: how often each triangle is divided in four before.
    arcs: edges (k, 2) of the outline and the rise (k, 2), mm, of the parabola above the middle of each.

    Raises `MeshDataError` where points, triangles and edges do not fit together.
    """
    carried = sp.eye_array(len(points), format="csr")
    for _ in range(finer):
        triangles, step = _subdivided(triangles, carried.shape[0])
        carried = step @ carried
    cells, step = _quads(triangles, carried.shape[0])
    carried = sp.csr_array(step @ carried)
    places = carried @ points if arcs is None else carried @ points + _raised(carried, *arcs)
    return SplitMesh(Mesh(places, cells, "quad", _boundaries(cells, carried, edges)), carried)


def _raised(carried: sp.csr_array, edges: Indices, rise: Array) -> Array:
    """How far each node (nodes, 2), mm, moves with arcs of a rise (k, 2) over edges (k, 2)."""
    columns = sp.csc_array(carried)
    both = 4 * sp.csc_array(columns[:, edges[:, 0]].multiply(columns[:, edges[:, 1]]))
    return np.asarray(both @ rise)


def _quads(triangles: Indices, n: int) -> tuple[Indices, sp.csr_array]:
    """Cells (3 m, 9), and the interpolation from n points to their nodes."""
    corners = np.stack([np.roll(triangles, -k, axis=1) for k in range(3)], axis=1)  # (m, 3, 3)
    weights = np.broadcast_to(PLACES, (*corners.shape[:2], *PLACES.shape))
    owners = np.where(weights > 0, corners[:, :, None], -1)  # (m, 3, 9, 3)
    order = np.argsort(owners, axis=-1, kind="stable")
    keys = np.concatenate([np.take_along_axis(a, order, axis=-1) for a in (owners, weights)], axis=-1).reshape(-1, 6)
    kinds, which = np.unique(keys, axis=0, return_inverse=True)
    number = np.empty(len(kinds), np.int64)
    is_point = kinds[:, 5] == WHOLE
    number[is_point] = kinds[is_point, 2]
    number[~is_point] = n + np.arange((~is_point).sum())
    cells = number[which.ravel()].reshape(-1, 9)
    used = kinds[:, 3:] > 0
    entries = np.repeat(number, used.sum(axis=1)), kinds[:, :3][used]
    carried = sp.csr_array((kinds[:, 3:][used] / WHOLE, entries), shape=(n + int((~is_point).sum()), n))
    return cells, carried


def _boundaries(cells: Indices, carried: sp.csr_array, named: Mapping[str, Indices]) -> dict[str, Indices]:
    """Edges (k, 3) of the quads on each named edge of the outline: the middle of one lies between the two points of its parent."""
    outline, _ = boundary_edges(cells, "quad")
    between = sp.csr_array(carried[outline[:, 2]])
    between.sort_indices()
    if (np.diff(between.indptr) != 2).any():
        raise MeshDataError("the outline of the triangles is not closed; check the triangles")
    parents = {tuple(pair): row for row, pair in enumerate(between.indices.reshape(-1, 2).tolist())}
    of_parent = np.fromiter((parents[tuple(pair)] for pair in between.indices.reshape(-1, 2).tolist()), np.int64)
    found = {}
    for name, edges in named.items():
        rows = [parents.get(tuple(sorted(pair))) for pair in edges.tolist()]
        if None in rows:
            raise MeshDataError(f"boundary '{name}' has edges that are not on the outline")
        found[name] = outline[np.isin(of_parent, np.array(rows, np.int64))]
    return found


def _subdivided(triangles: Indices, n: int) -> tuple[Indices, sp.csr_array]:
    """Each triangle in four, at the middles of its edges; and the interpolation from n points to the new ones."""
    pairs = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    edges, which = np.unique(pairs, axis=0, return_inverse=True)
    ab, bc, ca = (n + which.reshape(3, -1)).astype(np.int64)
    a, b, c = triangles.T
    finer = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
    rows = np.concatenate([np.arange(n), n + np.repeat(np.arange(len(edges)), 2)])
    weights = np.concatenate([np.ones(n), np.full(2 * len(edges), 0.5)])
    columns = np.concatenate([np.arange(n), edges.ravel()])
    return finer, sp.csr_array((weights, (rows, columns)), shape=(n + len(edges), n))
