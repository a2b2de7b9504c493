"""Points in the plane in; cell and local coordinates of a quadratic mesh out, and values and gradients there.

A point outside the mesh (in the sliver between a chord and a curved rim, say) goes to the nearest cell, whose
polynomial is continued.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from forward.errors import SolutionError
from meshes import Mesh
from meshes.elements import Element

Array = NDArray[np.float64]
INSIDE = 1e-9
CANDIDATES = (6, 40)
NEWTON_STEPS = 12
STRAIGHT, CURVED = (
    (3, 12),
    0.5,
)  # candidates by their corners; how far outside of these a point in a curved triangle may be


@dataclass(frozen=True)
class Places:
    """Where points lie: cell (k,), local coordinates (k, 2), how far outside in these (k,), 0 inside; a cell is two of them wide."""

    cells: NDArray[np.int64]
    local: Array
    excess: Array


def locate(mesh: Mesh, points: Array) -> Places:
    """Find points (k, 2), mm. Raises `SolutionError` for points that are not finite or far outside."""
    points = np.asarray(points, float).reshape(-1, 2)
    if not np.isfinite(points).all():
        raise SolutionError("points to evaluate must be finite numbers (k, 2), mm")
    tree = cKDTree(mesh.points[mesh.corners].mean(axis=1))
    cells = np.zeros(len(points), np.int64)
    local = np.zeros((len(points), 2))
    excess = np.full(len(points), np.inf)
    for k in CANDIDATES:
        lost = np.flatnonzero(excess > INSIDE)
        if not lost.size:
            break
        _, near = tree.query(points[lost], k=min(k, len(mesh.cells)))
        for candidate in near.reshape(len(lost), -1).T:
            _improve(mesh, points, lost, candidate, cells, local, excess)
    if excess.size and excess.max() > 1:
        far = points[excess.argmax()]
        raise SolutionError(f"point ({far[0]:g}, {far[1]:g}) is more than half a cell outside the mesh")
    return Places(cells, local, np.where(excess > INSIDE, excess, 0.0))


def in_triangles(mesh: Mesh, points: Array) -> Places:
    """Find points (k, 2), mm, in a mesh of triangles; the excess of those outside is above 0, and nothing else of them means anything.

    Many times as fast as `locate` where many points are outside: the triangle is that of the corners in which a point is, or nearly, and only the
    nodes of curved ones are inverted."""
    points = np.asarray(points, float).reshape(-1, 2)
    corners = mesh.points[mesh.corners]
    sides = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    bent = mesh.points[mesh.cells] - (corners[:, :1] + mesh.element.nodes @ sides.swapaxes(1, 2))
    curved = np.abs(bent).max(axis=(1, 2)) > INSIDE * np.abs(sides).max(axis=(1, 2))
    inverse, middles = np.linalg.inv(sides), corners.mean(axis=1)
    size = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
    reach = size * np.where(curved, 1 + 3 * CURVED, 1 + 3 * INSIDE)
    reach = np.append(reach, -np.inf)  # of no triangle, which the tree gives the last number
    tree, cells, local = cKDTree(middles), np.zeros(len(points), np.int64), np.zeros((len(points), 2))
    excess = np.full(len(points), np.inf)
    for most in STRAIGHT:
        lost = np.flatnonzero(excess > INSIDE)
        candidates = np.arange(min(most, len(corners))) + 1
        distances, near = tree.query(points[lost], candidates, distance_upper_bound=reach.max() * (1 + INSIDE))
        for distance, candidate in zip(distances.T, near.T, strict=True):
            still = (excess[lost] > INSIDE) & (distance <= reach[candidate])
            which, cell = lost[still], candidate[still]
            x, y = (points[which] - corners[cell, 0]).T
            xi = np.stack([inverse[cell, i, 0] * x + inverse[cell, i, 1] * y for i in range(2)], axis=1)
            outside = mesh.element.outside(xi)
            better = outside < excess[which]
            best = which[better]
            cells[best], local[best], excess[best] = cell[better], xi[better], outside[better]
    close = np.flatnonzero(curved[cells] & (excess < CURVED))
    local[close] = _invert(mesh.element, mesh.points[mesh.cells[cells[close]]], points[close])
    excess[close] = mesh.element.outside(local[close])
    return Places(cells, local, np.where(excess > INSIDE, excess, 0.0))


def values_at(mesh: Mesh, places: Places, nodal: Array) -> Array:
    """Values (..., k, c) of nodal fields (..., n, c)."""
    return np.einsum("kn,...knc->...kc", mesh.element.shapes(places.local), nodal[..., mesh.cells[places.cells], :])


def gradients_at(mesh: Mesh, places: Places, nodal: Array) -> Array:
    """Derivatives to x and y, (..., k, c, 2), 1/mm times their unit, of nodal fields (..., n, c)."""
    return np.einsum("kni,...knc->...kci", shape_slopes(mesh, places), nodal[..., mesh.cells[places.cells], :])


def shape_slopes(mesh: Mesh, places: Places) -> Array:
    """Derivatives (k, n, 2) to x and y, 1/mm, of the functions of the nodes of each cell."""
    slopes = mesh.element.gradients(places.local)
    to_local = np.linalg.inv(np.einsum("kni,knj->kij", mesh.points[mesh.cells[places.cells]], slopes))
    return np.asarray(np.einsum("knj,kji->kni", slopes, to_local))


def gauss_points(mesh: Mesh) -> tuple[Array, Array, Array]:
    """The q Gauss points of each cell: slopes (m, q, n, 2) of its functions, 1/mm; places (q m, 2), mm; weights (q m,), mm^2."""
    local, w = gauss_rule(mesh)
    nodes = mesh.points[mesh.cells]
    reference = mesh.element.gradients(local)
    J = np.einsum("qnk,mni->mqik", reference, nodes)
    slopes = np.einsum("qnk,mqkj->mqnj", reference, np.linalg.inv(J))
    places = np.einsum("qn,mni->mqi", mesh.element.shapes(local), nodes).reshape(-1, 2)
    return slopes, places, (np.linalg.det(J) * w).ravel()


def gauss_rule(mesh: Mesh) -> tuple[Array, Array]:
    """Local coordinates (q, 2) and weights (q,) of the points of a cell: nine of a quad; of a triangle those of Xiao and Gimbutas (2010) for the fifth degree."""
    if mesh.element.corners == 3:
        from forward._dolfinx import QUADRATURE_DEGREE, basix

        return basix.make_quadrature(basix.CellType.triangle, QUADRATURE_DEGREE)
    x, w = np.polynomial.legendre.leggauss(3)
    return np.array([(a, b) for b in x for a in x]), np.outer(w, w).ravel()


def _improve(mesh, points, which, candidate, cells, local, excess) -> None:
    """Take the candidate cell for those points that it holds, or to which it is nearer than the best so far."""
    open_ = excess[which] > INSIDE
    which, candidate = which[open_], candidate[open_]
    xi = _invert(mesh.element, mesh.points[mesh.cells[candidate]], points[which])
    outside = mesh.element.outside(xi)
    better = outside < excess[which]
    cells[which[better]] = candidate[better]
    local[which[better]] = xi[better]
    excess[which[better]] = outside[better]


def _invert(element: Element, nodes: Array, points: Array) -> Array:
    """Local coordinates (k, 2) of points (k, 2) in cells with nodes (k, n, 2); 9 where Newton's method fails."""
    xi = np.tile(element.middle, (len(points), 1))
    for _ in range(NEWTON_STEPS):
        error = points - np.einsum("kn,kni->ki", element.shapes(xi), nodes)
        J = np.einsum("kni,knj->kij", nodes, element.gradients(xi))
        singular = np.abs(np.linalg.det(J)) < 1e-12
        J[singular] = np.eye(2)
        step = np.linalg.solve(J, error[..., None])[..., 0]
        xi = np.clip(xi + step, -3, 3)
        if np.abs(step).max(initial=0) < 1e-13:
            break
    error = np.linalg.norm(points - np.einsum("kn,kni->ki", element.shapes(xi), nodes), axis=1)
    size = np.ptp(nodes, axis=1).max(axis=1)
    return np.where((error > 1e-9 * size)[:, None], 9.0, xi)
