"""Quadratic triangles of a triangulation, those at its outline divided in four: the outline stays what was measured.

In: points (n, 2), mm, anticlockwise triangles (m, 3), and edges of their outline by name. Out: a `Mesh` of triangles of six nodes, whose
first n nodes are the points; and for every node the points and shares that place it, so that what is known at the points is carried to the nodes.
Edges are straight, or parabolas through a given middle: a node that the linear triangle has at barycentric coordinates a, b, c is moved by 4 a b
times the bulge of the edge ab.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from meshes.errors import MeshDataError
from meshes.mesh import Mesh, boundary_edges, unique_edges

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class CurvedEdges:
    """edges (k, 2) of the outline; bulges (k, 2), mm: from the middle of the chord to that of the edge."""

    edges: Indices
    bulges: Array


@dataclass(frozen=True, eq=False)
class SplitMesh:
    """mesh: of triangles of six nodes. interpolation (nodes, n): linear within each triangle, from points to nodes."""

    mesh: Mesh
    interpolation: sp.csr_array


def split(
    points: Array, triangles: Indices, edges: Mapping[str, Indices], finer: int = 0, curved: CurvedEdges | None = None
) -> SplitMesh:
    """Quadratic triangles of a triangulation. edges: boundary name to edges (e, 2) of the outline. finer: how often each triangle is divided in four before.
    curved: edges that are not straight.

    Raises `MeshDataError` where points, triangles and edges do not fit together.
    """
    carried = sp.eye_array(len(points), format="csr")
    for _ in range(finer):
        triangles, step = _refined(triangles, carried.shape[0], np.arange(carried.shape[0]))
        carried = step @ carried
    triangles, step = _refined(triangles, carried.shape[0], np.unique(boundary_edges(triangles, "triangle")[0]))
    carried = sp.csr_array(step @ carried)
    middles, step = _middles(triangles, carried.shape[0])
    cells, carried = np.column_stack([triangles, middles]), sp.csr_array(step @ carried)
    places = carried @ points
    if curved is not None:
        shares = sp.csc_array(carried)
        places = places + 4 * (shares[:, curved.edges[:, 0]] * shares[:, curved.edges[:, 1]]) @ curved.bulges
    return SplitMesh(Mesh(places, cells, "triangle6", _boundaries(cells, carried, edges)), carried)


def _boundaries(cells: Indices, carried: sp.csr_array, named: Mapping[str, Indices]) -> dict[str, Indices]:
    """Edges (k, 3) of the triangles on each named edge of the outline: the middle of one lies between the two points of its parent."""
    outline, _ = boundary_edges(cells, "triangle6")
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


def _middles(triangles: Indices, n: int) -> tuple[Indices, sp.csr_array]:
    """Nodes (m, 3) in the middles of the edges 01, 12, 20, numbered from n on; and the interpolation from n points to all nodes."""
    edges, which = unique_edges(triangles)
    rows = np.concatenate([np.arange(n), n + np.repeat(np.arange(len(edges)), 2)])
    weights = np.concatenate([np.ones(n), np.full(2 * len(edges), 0.5)])
    columns = np.concatenate([np.arange(n), edges.ravel()])
    carried = sp.csr_array((weights, (rows, columns)), shape=(n + len(edges), n))
    return (n + which).astype(np.int64).T, carried


def _refined(triangles: Indices, n: int, nodes: Indices) -> tuple[Indices, sp.csr_array]:
    """Each triangle at one of the nodes in four, their neighbours in as many as their new nodes ask for; and the interpolation from n points to the new ones."""
    chosen = np.isin(triangles, nodes).any(axis=1)
    middles, carried = _middles(triangles, n)
    divided = np.zeros(carried.shape[0], bool)
    divided[middles[chosen]] = True
    number = np.concatenate([np.arange(n), np.full(len(divided) - n, -1)])
    number[n:][divided[n:]] = n + np.arange(int(divided.sum()))
    middles = number[middles]
    # turned so that the edge 01 is divided where one is, and the edge 20 is not where two are
    has = middles >= 0
    count = has.sum(axis=1)
    first = np.where(count == 2, (np.argmin(has, axis=1) + 1) % 3, np.argmax(has, axis=1))
    turned = (first[:, None] + np.arange(3)) % 3
    corners, between = (np.take_along_axis(one, turned, axis=1) for one in (triangles, middles))
    (a, b, c), (ab, bc, ca) = corners.T, between.T
    parts = {
        0: ((a, b, c),),
        1: ((a, ab, c), (ab, b, c)),
        2: ((ab, b, bc), (a, ab, bc), (a, bc, c)),
        3: ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)),
    }
    found = [np.stack(part, axis=1)[count == k] for k, some in parts.items() for part in some]
    return np.concatenate(found), sp.csr_array(carried[np.concatenate([np.arange(n), n + np.flatnonzero(divided[n:])])])
