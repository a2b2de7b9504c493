"""A plane mesh: points, cells and named boundaries in; quality, area, mirror images and a file out.

Quads are biquadratic: nine nodes a cell, edges on curved boundaries are parabolas through points of the exact
curve. Node order of a quad (VTK and gmsh): corners anticlockwise, then the middles of the edges 01, 12, 23,
30, then the centre. Triangles are straight.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meshes.errors import MeshDataError
from meshes.files import read_npz, with_prefix, write_npz

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NODES = {"triangle": 3, "quad": 9}
CORNERS = {"triangle": 3, "quad": 4}
MIRRORED_NODES = {"triangle": [0, 2, 1], "quad": [0, 3, 2, 1, 7, 6, 5, 4, 8]}
IDEAL = {"triangle": np.array([[1, 0.5], [0, np.sqrt(3) / 2]]), "quad": np.eye(2)}
QUAD_NODES = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (0, -1), (1, 0), (0, 1), (-1, 0), (0, 0)], float)


@dataclass(frozen=True, eq=False)
class Mesh:
    """Mesh of a specimen.

    points (n, 2), mm; cells (m, 3) or (m, 9); cell_type 'triangle' or 'quad'; boundaries: name to edges
    (e, 2) of triangles or (e, 3) of quads: two ends, then the middle. 'left', 'right', 'bottom', 'top' are
    the outer sides, 'free' all free edges, 'hole_0'... the rims, 'symmetry_x' (x = 0) and 'symmetry_y'
    (y = 0) the cuts of a quarter. Raises `MeshDataError` if the arrays do not fit together.
    """

    points: Array
    cells: Indices
    cell_type: str
    boundaries: dict[str, Indices]

    def __post_init__(self) -> None:
        if self.cell_type not in NODES:
            raise MeshDataError(f"cell type '{self.cell_type}' is unknown; use 'triangle' or 'quad'")
        if self.points.ndim != 2 or self.points.shape[1] != 2 or not np.isfinite(self.points).all():
            raise MeshDataError("points must be finite numbers of shape (n, 2)")
        if self.cells.ndim != 2 or self.cells.shape[1] != NODES[self.cell_type] or not len(self.cells):
            raise MeshDataError(f"a {self.cell_type} has {NODES[self.cell_type]} nodes: cells are {self.cells.shape}")
        for name, nodes in {"cells": self.cells, **self.boundaries}.items():
            if nodes.size and (nodes.min() < 0 or nodes.max() >= len(self.points)):
                raise MeshDataError(f"{name}: node numbers must lie between 0 and {len(self.points) - 1}")

    @property
    def corners(self) -> Indices:
        """Corner nodes of the cells, (m, 3) or (m, 4)."""
        return self.cells[:, : CORNERS[self.cell_type]]

    def boundary_nodes(self, name: str) -> Indices:
        """Sorted nodes (k,) of a boundary. Raises `MeshDataError` naming the boundaries there are."""
        return nodes_of(self.boundaries, name)

    @cached_property
    def quality(self) -> Array:
        """Signed inverse condition number (m,) of each cell, the worst of its corners (quads: nine nodes).

        2 det T / |T|^2 with T the map from the ideal cell; 1 is ideal, <= 0 is inverted.
        """
        T = self._jacobians(QUAD_NODES) @ np.linalg.inv(IDEAL[self.cell_type])
        return (2 * np.linalg.det(T) / (T**2).sum((-1, -2))).min(axis=1)

    def area(self) -> float:
        """Area, mm^2; exact for the curved cells as well."""
        if self.cell_type == "triangle":
            return float(np.linalg.det(self._jacobians()).sum() / 2)
        x, w = np.polynomial.legendre.leggauss(3)
        J = self._jacobians(np.array([(a, b) for a in x for b in x]))
        return float((np.linalg.det(J) @ np.outer(w, w).ravel()).sum())

    def mirrored(self) -> tuple[Mesh, Indices, Array]:
        """Full mesh of a quarter, with the quarter's node (n,) each node copies and the signs (n, 2) of x, y.

        Raises `MeshDataError` for what is no quarter.
        """
        mesh, source = self, np.arange(len(self.points))
        signs = np.ones_like(self.points)
        for axis, cut in enumerate(("symmetry_x", "symmetry_y")):
            if cut not in mesh.boundaries:
                raise MeshDataError(f"no boundary '{cut}': only a quarter can be mirrored")
            mesh, source, signs = _mirror(mesh, axis, cut, source, signs)
        return mesh, source, signs

    def save(self, path: str | Path) -> None:
        """Write a .npz atomically. Raises `MeshDataError` where it cannot be written."""
        edges = {f"boundary_{name}": nodes for name, nodes in self.boundaries.items()}
        write_npz(path, "equigap-mesh", points=self.points, cells=self.cells, cell_type=self.cell_type, **edges)

    @classmethod
    def load(cls, path: str | Path) -> Mesh:
        """Read what `save` wrote. Raises `MeshDataError`."""
        content = read_npz(path, "equigap-mesh", ("points", "cells", "cell_type"))
        edges = with_prefix(content, "boundary_")
        return cls(content["points"], content["cells"], str(content["cell_type"]), edges)

    def _jacobians(self, at: Array = QUAD_NODES) -> Array:
        """dx/dxi (m, k, 2, 2): of triangles (k = 1, unit triangle), of quads at k places in [-1, 1]^2."""
        if self.cell_type == "triangle":
            a, b, c = np.moveaxis(self.points[self.cells], 1, 0)
            return np.stack([b - a, c - a], axis=-1)[:, None]
        return np.einsum("qnj,mni->mqij", quad_shape_gradients(at), self.points[self.cells])


def nodes_of(boundaries: Mapping[str, Indices], name: str) -> Indices:
    """Sorted nodes (k,) of one of the boundaries. Raises `MeshDataError` naming those there are."""
    if name not in boundaries:
        raise MeshDataError(f"boundary '{name}' is unknown; this mesh has {', '.join(boundaries)}")
    return np.unique(boundaries[name])


def quad_shapes(xi: Array) -> Array:
    """Biquadratic shape functions (k, 9) at places (k, 2) in [-1, 1]^2."""
    values = _lagrange(xi)
    return np.stack([values[:, 0, _node(a)] * values[:, 1, _node(b)] for a, b in QUAD_NODES], axis=1)


def quad_shape_gradients(xi: Array) -> Array:
    """Their derivatives (k, 9, 2) to the two coordinates."""
    values, slopes = _lagrange(xi), _lagrange_slopes(xi)
    return np.stack(
        [
            np.stack(
                [
                    slopes[:, 0, _node(a)] * values[:, 1, _node(b)],
                    values[:, 0, _node(a)] * slopes[:, 1, _node(b)],
                ],
                axis=-1,
            )
            for a, b in QUAD_NODES
        ],
        axis=1,
    )


def boundary_edges(cells: Indices, cell_type: str) -> tuple[Indices, Indices]:
    """Edges that belong to one cell only, (e, 2) for triangles or (e, 3) for quads, the cell on their left; and these cells (e,)."""
    n = CORNERS[cell_type]
    columns = [(i, (i + 1) % n, *([n + i] if cell_type == "quad" else [])) for i in range(n)]
    edges = np.concatenate([cells[:, c] for c in columns])
    _, first, count = np.unique(np.sort(edges[:, :2], axis=1), axis=0, return_index=True, return_counts=True)
    single = first[count == 1]
    return edges[single], single % len(cells)


def _node(coordinate: float) -> int:
    return int(coordinate) + 1


def _lagrange(xi: Array) -> Array:
    """Quadratic polynomials (..., 3) that are 1 at -1, 0, 1."""
    return np.stack([xi * (xi - 1) / 2, 1 - xi**2, xi * (xi + 1) / 2], axis=-1)


def _lagrange_slopes(xi: Array) -> Array:
    return np.stack([xi - 0.5, -2 * xi, xi + 0.5], axis=-1)


def _mirror(mesh: Mesh, axis: int, cut: str, source: Indices, signs: Array) -> tuple[Mesh, Indices, Array]:
    """Mesh and its image under x -> -x (axis 0) or y -> -y (axis 1), joined at the boundary `cut`."""
    n = len(mesh.points)
    moves = np.ones(n, bool)
    moves[mesh.boundary_nodes(cut)] = False
    image = np.arange(n)
    image[moves] = n + np.arange(moves.sum())
    flip = np.where(np.arange(2) == axis, -1.0, 1.0)
    cells = np.concatenate([mesh.cells, image[mesh.cells][:, MIRRORED_NODES[mesh.cell_type]]])
    points = np.concatenate([mesh.points, mesh.points[moves] * flip])
    renamed = {"right": "left"} if axis == 0 else {"top": "bottom"}
    boundaries: dict[str, Indices] = {}
    for name, edges in mesh.boundaries.items():
        if name == cut or name.startswith("hole_"):
            continue
        if name in renamed:
            boundaries |= {renamed[name]: _reverse(image[edges]), name: edges}
        else:
            boundaries[name] = np.concatenate([edges, _reverse(image[edges])])
    full = Mesh(points, cells, mesh.cell_type, boundaries)
    return full, np.concatenate([source, source[moves]]), np.concatenate([signs, signs[moves] * flip])


def _reverse(edges: Indices) -> Indices:
    return np.concatenate([edges[:, 1::-1], edges[:, 2:]], axis=1)
