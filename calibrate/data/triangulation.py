"""Edges, boundary and areas of a triangulation.

In: triangles (m, 3), counter-clockwise, of points (n, 2) mm. Out: edges as pairs of nodes, with the triangles that own them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshes import mesh
from meshes.mesh import half_edges, signed_areas, unique_edges

__all__ = ["boundary_edges", "boundary_nodes", "half_edges", "signed_areas", "unique_edges"]
Indices = NDArray[np.int64]


def boundary_edges(triangles: Indices) -> tuple[Indices, Indices]:
    """Edges (k, 2) of one triangle only, outline and holes, and their triangles (k,); the specimen is on the left of each."""
    return mesh.boundary_edges(triangles, "triangle")


def boundary_nodes(triangles: Indices) -> Indices:
    """Sorted nodes (k,) on the boundary: outline and holes."""
    return np.unique(boundary_edges(triangles)[0])
