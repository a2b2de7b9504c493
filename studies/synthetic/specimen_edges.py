"""Edges of a specimen: whether points lie inside, and which way is inward. Specimens and meshes in, arrays out; mm."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from meshes import Mesh, Specimen
from meshes.shapes import signed_distance

Array = NDArray[np.float64]
SIDES = ("left", "right", "bottom", "top")


def inside(specimen: Specimen, points: Array) -> NDArray[np.bool_]:
    """Whether points (n, 2), mm, lie in the specimen; those on its edge within a millionth of its extent do."""
    slack = 1e-6 * max(specimen.half_extent)
    outline = specimen.outline()
    found = np.concatenate(
        [signed_distance(p, outline) > -slack for p in np.array_split(points, len(points) // 5000 + 1)]
    )
    for hole in specimen.holes():
        found &= hole.level(points) > 1 - slack / hole.b
    return found


def inward(mesh: Mesh) -> Array:
    """Unit inward normals (n, 2) at free edges, continued smoothly into the triangles; grips stay on their lines."""
    n = len(mesh.points)
    edges = mesh.boundaries["free"]
    along = mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]]
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    middle = mesh.points[edges].mean(axis=1)
    normal *= np.sign(((_thirds(mesh, edges) - middle) * normal).sum(axis=1))[:, None]
    shift = np.zeros((n, 2))
    for k in range(2):
        np.add.at(shift, edges[:, k], normal)
    held = np.zeros((n, 2), bool)
    free = np.unique(edges)
    shift[free] /= np.linalg.norm(shift[free], axis=1, keepdims=True)
    held[free] = True
    for side in set(SIDES) & set(mesh.boundaries):
        nodes = mesh.boundary_nodes(side)
        held[nodes, 0 if side in ("left", "right") else 1] = True
    pairs = np.concatenate([mesh.cells[:, [0, 1]], mesh.cells[:, [1, 2]], mesh.cells[:, [2, 0]]])
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    graph = sp.csr_array((np.ones(len(pairs)), pairs.T), shape=(n, n))
    laplacian = sp.csc_array(sp.diags_array(graph.sum(axis=1)) - graph)
    for axis in range(2):
        known, open_ = np.flatnonzero(held[:, axis]), np.flatnonzero(~held[:, axis])
        right = -laplacian[open_][:, known] @ shift[known, axis]
        shift[open_, axis] = spsolve(laplacian[open_][:, open_], right)
    return shift


def _thirds(mesh: Mesh, edges: NDArray[np.int64]) -> Array:
    """Centroids (e, 2) of the triangles that the boundary edges belong to."""
    n = len(mesh.points)
    pairs = np.concatenate([mesh.cells[:, [0, 1]], mesh.cells[:, [1, 2]], mesh.cells[:, [2, 0]]])
    key = np.sort(pairs, axis=1) @ [n, 1]
    order = np.argsort(key)
    owner = order[np.searchsorted(key[order], np.sort(edges[:, :2], axis=1) @ [n, 1])] % len(mesh.cells)
    return mesh.points[mesh.cells[owner]].mean(axis=1)
