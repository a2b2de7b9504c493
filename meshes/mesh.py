"""A plane mesh: points, cells and named boundaries in; quality, area, mirror images and a file out.

Edges of quads and of triangles of six nodes are parabolas; on curved boundaries they go through points of the exact curve. Other triangles are straight.
Node orders: see `meshes.elements`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from meshes.elements import ELEMENTS, Element
from meshes.errors import MeshDataError
from meshes.files import read_npz, with_prefix, write_npz

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Mesh:
    """Mesh of a specimen.

    points (n, 2), mm; cells (m, nodes of one); cell_type 'triangle', 'triangle6' or 'quad'; boundaries: name to edges
    (e, 2) of straight triangles or (e, 3) of others: two ends, then the middle. 'left', 'right', 'bottom', 'top' are
    the outer sides, 'free' all free edges, 'hole_0'... the rims, 'symmetry_x' (x = 0) and 'symmetry_y'
    (y = 0) the cuts of a quarter. Raises `MeshDataError` if the arrays do not fit together.
    """

    points: Array
    cells: Indices
    cell_type: str
    boundaries: dict[str, Indices]

    def __post_init__(self) -> None:
        if self.cell_type not in ELEMENTS:
            raise MeshDataError(f"cell type '{self.cell_type}' is unknown; use {', '.join(map(repr, ELEMENTS))}")
        if self.points.ndim != 2 or self.points.shape[1] != 2 or not np.isfinite(self.points).all():
            raise MeshDataError("points must be finite numbers of shape (n, 2)")
        count = len(self.element.nodes)
        if self.cells.ndim != 2 or self.cells.shape[1] != count or not len(self.cells):
            raise MeshDataError(f"a {self.cell_type} has {count} nodes: cells are {self.cells.shape}")
        for name, nodes in {"cells": self.cells, **self.boundaries}.items():
            if nodes.size and (nodes.min() < 0 or nodes.max() >= len(self.points)):
                raise MeshDataError(f"{name}: node numbers must lie between 0 and {len(self.points) - 1}")

    @property
    def element(self) -> Element:
        """What its cells are."""
        return ELEMENTS[self.cell_type]

    @property
    def corners(self) -> Indices:
        """Corner nodes of the cells, (m, 3) or (m, 4)."""
        return self.cells[:, : self.element.corners]

    def boundary_nodes(self, name: str) -> Indices:
        """Sorted nodes (k,) of a boundary. Raises `MeshDataError` naming the boundaries there are."""
        return nodes_of(self.boundaries, name)

    @cached_property
    def quality(self) -> Array:
        """Signed inverse condition number (m,) of each cell, the worst of its nodes.

        2 det T / |T|^2 with T the map from the ideal cell; 1 is ideal, <= 0 is inverted.
        """
        T = self._jacobians(self.element.nodes) @ np.linalg.inv(self.element.ideal)
        return (2 * np.linalg.det(T) / (T**2).sum((-1, -2))).min(axis=1)

    def area(self) -> float:
        """Area, mm^2; exact for the curved cells as well."""
        x, w = np.polynomial.legendre.leggauss(3)
        places, weights = np.array([(a, b) for a in x for b in x]), np.outer(w, w).ravel()
        if self.element.corners == 3:  # the square folded to a triangle
            a, b = (0.5 + 0.5 * places).T
            places, weights = np.column_stack([a, b * (1 - a)]), weights * (1 - a) / 4
        return float((np.linalg.det(self._jacobians(places)) @ weights).sum())

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

    def _jacobians(self, at: Array) -> Array:
        """dx/dxi (m, k, 2, 2) at local coordinates (k, 2)."""
        return np.einsum("qnj,mni->mqij", self.element.gradients(at), self.points[self.cells])


def nodes_of(boundaries: Mapping[str, Indices], name: str) -> Indices:
    """Sorted nodes (k,) of one of the boundaries. Raises `MeshDataError` naming those there are."""
    if name not in boundaries:
        raise MeshDataError(f"boundary '{name}' is unknown; this mesh has {', '.join(boundaries)}")
    return np.unique(boundaries[name])


def boundary_edges(cells: Indices, cell_type: str) -> tuple[Indices, Indices]:
    """Edges that belong to one cell only, (e, 2) of straight triangles or (e, 3) of others, the cell on their left; and these cells (e,)."""
    element = ELEMENTS[cell_type]
    n = element.corners
    columns = [(i, (i + 1) % n, *([n + i] if element.edges_have_middles else [])) for i in range(n)]
    edges = np.concatenate([cells[:, c] for c in columns])
    _, first, count = np.unique(_edge_keys(edges), return_index=True, return_counts=True)
    single = first[count == 1]
    return edges[single], single % len(cells)


def half_edges(triangles: Indices) -> Indices:
    """(3 m, 2): edge a m + e runs from corner a to the next corner of triangle e, so that the triangle is on its left."""
    return np.concatenate([triangles[:, [a, (a + 1) % 3]] for a in range(3)])


def unique_edges(triangles: Indices) -> tuple[Indices, Indices]:
    """Every edge once, (e, 2) with the smaller node first, and the number (3, m) of the edge behind each corner."""
    every = half_edges(triangles)
    _, first, number = np.unique(_edge_keys(every), return_index=True, return_inverse=True)
    return np.sort(every[first], axis=1), number.reshape(3, len(triangles))


def _edge_keys(edges: Indices) -> Indices:
    """A number (e,) for each edge (e, 2 or more), the same for both directions; in the order of the smaller, then of the larger node."""
    ends = np.sort(edges[:, :2], axis=1).astype(np.int64)
    return np.asarray(ends[:, 0] * (ends.max(initial=0) + 1) + ends[:, 1])


def signed_areas(points: Array, triangles: Indices) -> Array:
    """Signed areas (n_triangles,) of `points` (n, 2), `triangles` (m, 3); positive counter-clockwise, mm^2."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return 0.5 * ((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))


def spacing_of(points: Array) -> float:
    """Median distance of points (n, 2) to the nearest other one, mm."""
    return float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))


def within(points: Array, triangles: Indices, where: Array, overshoot: float = 1e-6) -> NDArray[np.bool_]:
    """Whether positions (k, 2) lie in any of the triangles, or beside one by less than `overshoot` of its height."""
    corners = points[triangles]
    centres = corners.mean(axis=1)
    reach = float(np.linalg.norm(corners - centres[:, None], axis=2).max())
    inside = np.zeros(len(where), bool)
    near = cKDTree(centres).query_ball_point(where, reach)
    size = np.fromiter((len(n) for n in near), np.int64, len(near))
    if size.sum() == 0:
        return inside
    who = np.repeat(np.arange(len(where)), size)
    which = np.concatenate([np.asarray(n, np.int64) for n in near])
    a, b, c = (corners[which, i] for i in range(3))
    edges = np.stack([b - a, c - a], axis=-1)
    local = np.linalg.solve(edges, (where[who] - a)[..., None])[..., 0]
    hit = (local.min(axis=1) > -overshoot) & (local.sum(axis=1) < 1 + overshoot)
    inside[who[hit]] = True
    return inside


def _mirror(mesh: Mesh, axis: int, cut: str, source: Indices, signs: Array) -> tuple[Mesh, Indices, Array]:
    """Mesh and its image under x -> -x (axis 0) or y -> -y (axis 1), joined at the boundary `cut`."""
    n = len(mesh.points)
    moves = np.ones(n, bool)
    moves[mesh.boundary_nodes(cut)] = False
    image = np.arange(n)
    image[moves] = n + np.arange(moves.sum())
    flip = np.where(np.arange(2) == axis, -1.0, 1.0)
    cells = np.concatenate([mesh.cells, image[mesh.cells][:, list(mesh.element.mirrored)]])
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
