"""Edges, boundary and areas of a triangulation.

In: triangles (m, 3), counter-clockwise, of points (n, 2) mm. Out: edges as pairs of nodes, with the triangles that own them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshes import mesh
from meshes.mesh import signed_areas

__all__ = ["boundary_edges", "boundary_nodes", "half_edges", "signed_areas", "unique_edges"]
Indices = NDArray[np.int64]


def half_edges(triangles: Indices) -> Indices:
    """(3 m, 2): edge a m + e runs from corner a to the next corner of triangle e, so that the triangle is on its left."""
    return np.concatenate([triangles[:, [a, (a + 1) % 3]] for a in range(3)])


def unique_edges(triangles: Indices) -> tuple[Indices, Indices]:
    """Every edge once, (e, 2) with the smaller node first, and the number (3, m) of the edge behind each corner."""
    every = half_edges(triangles)
    _, first, number = np.unique(mesh.edge_keys(every), return_index=True, return_inverse=True)
    return np.sort(every[first], axis=1), number.reshape(3, len(triangles))


def boundary_edges(triangles: Indices) -> tuple[Indices, Indices]:
    """Edges (k, 2) of one triangle only, outline and holes, and their triangles (k,); the specimen is on the left of each."""
    return mesh.boundary_edges(triangles, "triangle")


def boundary_nodes(triangles: Indices) -> Indices:
    """Sorted nodes (k,) on the boundary: outline and holes."""
    return np.unique(boundary_edges(triangles)[0])
