"""Second-order kinematics on measured triangles: displacement gradients at centroids, areas with curved edges.

In: points (n, 2) mm, triangles (m, 3), nodes of free edges. Out: a sparse operator from nodal values to gradients at the
centroids, and areas. Gradients stay linear in the displacements; nothing is iterated.

A linear triangle sees the field between its nodes as straight, and a hole as a polygon. Both errors are of second order
and systematic, so that they outgrow the noise of a good measurement. Here

- gradients g at the nodes come from weighted least-squares quadratics over two rings of neighbours (Zhang and Naga 2005,
  SIAM J. Sci. Comput. 26, 1192), or from linear functions where the nodes do not determine a quadratic well;
- on the edge from i to j the field then is (u_i + u_j) / 2 + (g_i - g_j) . (x_j - x_i) / 8 in the middle, as a cubic of
  Hermite has it, and the triangle a quadratic one;
- where free edges form a smooth curve, the area of the circular segment L^3 curvature / 12 is added or taken away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.data.triangulation import boundary_edges
from calibrate.equations.kinematics import gradient_operator, shape_gradients
from meshes.measured.curved_outline import is_smooth

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
SMOOTH = np.radians(55)  # a larger turn between two edges is a corner; tips of coarsely meshed ellipses are none
SEGMENT = 0.2  # largest share of its triangle that a segment may have
GROWTH = 5.0  # largest noise of a quadratic fit over that of a linear one; 3 at corners of a sound mesh


def centroid_gradients(points: Array, triangles: Indices) -> sp.csr_array:
    """Operator (2 m, n), 1/mm: nodal values to gradients at centroids; rows as in `gradient_operator`."""
    linear = gradient_operator(points, triangles)
    slopes = shape_gradients(points, triangles)[0]
    recovered = nodal_gradients(points, triangles)
    m = len(triangles)
    correction = [sp.csr_array((m, len(points))) for _ in range(2)]
    for a in range(3):
        i, j = triangles[:, a], triangles[:, (a + 1) % 3]
        edge = (points[j] - points[i]) / 8
        middle = sum(sp.diags_array(edge[:, k]) @ (recovered[k][i] - recovered[k][j]) for k in range(2))
        opposite = slopes[:, (a + 2) % 3]
        correction = [correction[k] - sp.diags_array(4 / 3 * opposite[:, k]) @ middle for k in range(2)]
    both = sp.csr_array(sp.vstack(correction))
    interleaved = np.arange(2 * m).reshape(2, m).T.ravel()
    return sp.csr_array(linear + both[interleaved])


def nodal_gradients(points: Array, triangles: Indices) -> list[sp.csr_array]:
    """Operators (n, n), 1/mm, to the x and y derivative at the nodes, from two rings of neighbours; no derivative at a
    node without a triangle."""
    n = len(points)
    corners = sp.csr_array(
        (np.ones(triangles.size), (np.repeat(np.arange(len(triangles)), 3), triangles.ravel())),
        shape=(len(triangles), n),
    )
    ring = corners.T @ corners
    rings = sp.csr_array(ring @ ring)
    rings.sort_indices()
    counts = np.diff(rings.indptr)
    values = np.zeros((2, rings.nnz))
    for count in np.unique(counts[counts > 0]):
        nodes = np.flatnonzero(counts == count)
        at = rings.indptr[nodes][:, None] + np.arange(count)
        values[:, at] = _fit(points[rings.indices[at]] - points[nodes][:, None])
    return [sp.csr_array((v, rings.indices.copy(), rings.indptr.copy()), shape=(n, n)) for v in values]


def _fit(offset: Array) -> Array:
    """Weights (2, k, q) of the gradient in the middle of points at offsets (k, q, 2)."""
    monomials, weight, reach = _monomials(offset)
    best = _least_squares(monomials[:, :, :3])
    if offset.shape[1] >= 6:
        quadratic = _least_squares(monomials)
        noise = [np.linalg.norm(fit, axis=(1, 2)) for fit in (best, quadratic)]
        good = noise[1] < GROWTH * noise[0]
        best[good] = quadratic[good]
    return np.moveaxis(best * (weight / reach)[:, None, :], 1, 0)


def _monomials(offset: Array) -> tuple[Array, Array, Array]:
    """Weighted monomials (k, q, 6), weights (k, q) and reach (k, 1) of points at offsets (k, q, 2)."""
    reach = np.linalg.norm(offset, axis=2).max(axis=1)[:, None]
    x, y = np.moveaxis(offset / reach[:, :, None], 2, 0)
    weight = 1 / (x**2 + y**2 + 0.05)
    # these monomials turn with the axes, so that the choice of the order does not depend on them
    monomials = np.stack([np.ones_like(x), x, y, x**2 + y**2, x**2 - y**2, 2 * x * y], axis=2)
    return monomials * weight[:, :, None], weight, reach


def _least_squares(columns: Array) -> Array:
    """Rows 1 and 2 (k, 2, q) of the pseudo-inverse of columns (k, q, p); infinite where they depend on each other."""
    Q, R = np.linalg.qr(columns)
    diagonal = np.abs(np.diagonal(R, axis1=1, axis2=2))
    regular = diagonal.min(axis=1) > 1e-10 * diagonal.max(axis=1)
    rows = np.full((len(R), 2, columns.shape[1]), np.inf)
    rows[regular] = np.linalg.inv(R[regular])[:, 1:3] @ Q[regular].swapaxes(1, 2)
    return rows


@dataclass(frozen=True)
class Segments:
    """Between free edges (k, 2), the specimen on their left, and the circle through their neighbours: owners (k,), triangles; areas (k,), mm^2,
    negative where the edge bends inwards."""

    edges: Indices
    owners: Indices
    areas: Array

    def bulges(self, points: Array) -> Array:
        """By how far the middle of each edge is from its chord (k, 2), mm."""
        chord = points[self.edges[:, 1]] - points[self.edges[:, 0]]
        outwards = np.stack([chord[:, 1], -chord[:, 0]], axis=1)
        return 1.5 * (self.areas / (chord**2).sum(axis=1))[:, None] * outwards  # a parabola


def areas(points: Array, triangles: Indices, free_nodes: Indices) -> Array:
    """Areas (m,), mm^2, of triangles whose free edges (both nodes free) follow the circle through their neighbours."""
    found = segments(points, triangles, free_nodes)
    return shape_gradients(points, triangles)[1] + np.bincount(found.owners, found.areas, len(triangles))


def segments(points: Array, triangles: Indices, free_nodes: Indices) -> Segments:
    """Of all free edges of triangles."""
    edges, owner = boundary_edges(triangles)
    free = np.isin(edges, free_nodes).all(axis=1)
    edges, owner = edges[free], owner[free]
    (start, end), plain = edges.T, shape_gradients(points, triangles)[1]
    edge = points[end] - points[start]
    # the edge after each one; none where edges of two holes meet in a node
    follower = np.full(len(points), -1)
    follower[start] = np.arange(len(start))
    follower[np.bincount(start, minlength=len(points)) > 1] = -1
    turning = np.flatnonzero(follower[end] >= 0)
    after = follower[end[turning]]
    cross = edge[turning, 0] * edge[after, 1] - edge[turning, 1] * edge[after, 0]
    turn, every = np.arctan2(cross, (edge[turning] * edge[after]).sum(axis=1)), np.zeros(len(start))
    every[turning] = turn
    chord = np.linalg.norm(points[end[after]] - points[start[turning]], axis=1)
    smooth = is_smooth(every, follower[end], SMOOTH)[turning]
    curvature = np.full(len(points), np.nan)
    curvature[end[turning[smooth]]] = 2 * np.sin(turn[smooth]) / chord[smooth]
    at_ends = np.stack([curvature[start], curvature[end]])
    known = np.isfinite(at_ends)
    mean = np.where(known, at_ends, 0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    limit = SEGMENT * plain[owner]
    return Segments(edges, owner, np.clip(mean * np.linalg.norm(edge, axis=1) ** 3 / 12, -limit, limit))
