"""A plane mesh, a thickness and layers in; a mesh of triquadratic hexes with named boundaries out. Lengths in mm.

The hexes stand on the quads of the plane mesh, so rims stay second-order curves and the nodes of the surface are
those of the plane mesh. A node's number is level * n + k, with k its number in the plane mesh of n nodes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from meshes.elements import QUAD_NODES, quad_shape_gradients, quad_shapes
from meshes.errors import MeshDataError, MeshQualityError
from meshes.mesh import Array, Indices, Mesh, nodes_of

MIN_QUALITY = 0.3
GRADING = 0.7  # thickness of a layer relative to its neighbour further inside
LEVEL = (-1.0, 0.0, 1.0)
HEX_NODES = np.array([(x, y, z) for z in LEVEL for x, y in QUAD_NODES])


@dataclass(frozen=True, eq=False)
class SolidMesh:
    """Triquadratic hexes above a plane mesh.

    plane: quads (m, 9); levels (2 layers + 1,): heights of the node planes, rising, mm; symmetric: whether the
    mid-plane z = 0 is a symmetry cut and only the half above it is there. Raises `MeshDataError`.
    """

    plane: Mesh
    levels: Array
    symmetric: bool = True

    def __post_init__(self) -> None:
        if self.plane.cell_type != "quad":
            raise MeshDataError("hexes stand on quads; make the plane mesh with meshes.quads")
        levels = np.asarray(self.levels)
        if levels.ndim != 1 or len(levels) < 3 or len(levels) % 2 == 0 or not (np.diff(levels) > 0).all():
            raise MeshDataError("levels must rise, two for each layer and one more, in mm")
        if self.symmetric and abs(levels[0]) > 0:
            raise MeshDataError(f"the lowest level of a symmetric half must be 0, not {levels[0]:g} mm")

    @property
    def layers(self) -> int:
        """Layers of hexes that are there: of the half, if symmetric."""
        return len(self.levels) // 2

    @property
    def thickness(self) -> float:
        """Thickness of the whole specimen, mm."""
        height = float(self.levels[-1] - self.levels[0])
        return 2 * height if self.symmetric else height

    @cached_property
    def points(self) -> Array:
        """Nodes (n, 3), mm."""
        n = len(self.plane.points)
        return np.column_stack([np.tile(self.plane.points, (len(self.levels), 1)), np.repeat(self.levels, n)])

    @cached_property
    def cells(self) -> Indices:
        """Nodes of each hex (m, 27): those of the quad below, half-way up and above, each in the quad's order."""
        n = len(self.plane.points)
        stack = [np.hstack([self.plane.cells + (2 * k + i) * n for i in range(3)]) for k in range(self.layers)]
        return np.concatenate(stack)

    @cached_property
    def boundaries(self) -> dict[str, Indices]:
        """Nodes of the faces (f, 9) by name: the plane mesh's, and 'surface', and 'symmetry_z' or 'back' below."""
        n = len(self.plane.points)
        faces = {}
        for name, edges in self.plane.boundaries.items():
            stack = [np.hstack([edges + (2 * k + i) * n for i in range(3)]) for k in range(self.layers)]
            faces[name] = np.concatenate(stack)
        below = "symmetry_z" if self.symmetric else "back"
        return {**faces, below: self.plane.cells, "surface": self.plane.cells + 2 * self.layers * n}

    def boundary_nodes(self, name: str) -> Indices:
        """Sorted nodes (k,) of a boundary. Raises `MeshDataError` naming the boundaries there are."""
        return nodes_of(self.boundaries, name)

    @cached_property
    def quality(self) -> Array:
        """Signed inverse condition number (m,) of each hex's shape, height aside: that of the quad it stands on.

        A hex that is flat or tall is not a bad one here; `aspect` tells.
        """
        return np.tile(self.plane.quality, self.layers)

    @property
    def aspect(self) -> Array:
        """Height of each hex over the square root of its base area, (m,)."""
        base = np.sqrt(np.abs(self._base_jacobians()).mean(axis=1) * 4)
        return np.concatenate([h / base for h in np.diff(self.levels[::2])])

    def volume(self) -> float:
        """Volume of what is meshed, mm^3; exact for the curved cells as well."""
        return self.plane.area() * float(self.levels[-1] - self.levels[0])

    def _base_jacobians(self) -> Array:
        slopes = quad_shape_gradients(QUAD_NODES)
        return np.linalg.det(np.einsum("qnj,mni->mqij", slopes, self.plane.points[self.plane.cells]))


def extrude(plane: Mesh, thickness: float, layers: int, whole: bool = False, grading: float = GRADING) -> SolidMesh:
    """Hexes of the half above the mid-plane with `layers` layers, or of the whole thickness with twice as many.

    plane: quads of a quarter (an eighth model results) or of the full specimen. thickness: of the whole specimen, mm.
    grading: thickness of a layer relative to the one below it, < 1 for thin layers at the surface. Raises
    `MeshDataError`, `MeshQualityError`.
    """
    if not (math.isfinite(thickness) and thickness > 0):
        raise MeshDataError(f"thickness = {thickness} mm; give a positive number")
    if layers < 1 or layers != int(layers) or not (0.2 <= grading <= 5):
        raise MeshDataError(
            f"{layers} layers with grading {grading}: a whole number of layers, at least one, and grading between 0.2 and 5"
        )
    heights = grading ** np.arange(layers)
    ends = np.concatenate([[0], np.cumsum(heights)]) * (thickness / 2 / heights.sum())
    ends[-1] = thickness / 2
    if whole:
        ends = np.concatenate([-ends[:0:-1], ends])
    levels = np.empty(2 * len(ends) - 1)
    levels[::2], levels[1::2] = ends, (ends[1:] + ends[:-1]) / 2
    solid = SolidMesh(plane, levels, symmetric=not whole)
    if solid.quality.min() < MIN_QUALITY:
        raise MeshQualityError(
            f"the worst cell has quality {solid.quality.min():.2f}, at least {MIN_QUALITY} is needed; "
            "make the plane mesh finer or closer to uniform"
        )
    return solid


def hex_shapes(xi: Array) -> Array:
    """Triquadratic shape functions (k, 27) at places (k, 3) in [-1, 1]^3, in the order of a cell's nodes."""
    plane, along = quad_shapes(xi[:, :2]), _line(xi[:, 2])
    return (along[:, :, None] * plane[:, None, :]).reshape(len(xi), 27)


def hex_shape_gradients(xi: Array) -> Array:
    """Their derivatives (k, 27, 3) to the three coordinates."""
    plane, along = quad_shapes(xi[:, :2]), _line(xi[:, 2])
    slopes, rise = quad_shape_gradients(xi[:, :2]), _line_slopes(xi[:, 2])
    in_plane = along[:, :, None, None] * slopes[:, None]
    upward = rise[:, :, None] * plane[:, None, :]
    return np.concatenate([in_plane, upward[..., None]], axis=-1).reshape(len(xi), 27, 3)


def _line(x: NDArray[np.float64]) -> Array:
    """Quadratic polynomials (k, 3) that are 1 at -1, 0, 1."""
    return np.stack([x * (x - 1) / 2, 1 - x**2, x * (x + 1) / 2], axis=-1)


def _line_slopes(x: NDArray[np.float64]) -> Array:
    return np.stack([x - 0.5, -2 * x, x + 0.5], axis=-1)
