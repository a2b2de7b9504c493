"""Shape functions of the cells of a plane mesh: local coordinates in, values and derivatives out.

A triangle of three nodes is straight. One of six, `triangle6`, is quadratic: corners anticlockwise, then the middles of the edges 01, 12, 20; its local
coordinates are those of the second and third corner. A quad is biquadratic, of nine nodes: corners, the middles of the edges 01, 12, 23, 30, the
centre; its local coordinates are in [-1, 1]^2. The order of nodes is that of VTK and gmsh.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

QUAD_NODES = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (0, -1), (1, 0), (0, 1), (-1, 0), (0, 0)], float)
TRIANGLE_NODES = np.array([(0, 0), (1, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0, 0.5)])
_EQUILATERAL = np.array([[1, 0.5], [0, np.sqrt(3) / 2]])
_BARYCENTRIC = np.array([[-1, -1], [1, 0], [0, 1]], float)  # derivatives of the barycentric coordinates


@dataclass(frozen=True)
class Element:
    """One kind of cell. corners: of its nodes; edges_have_middles; mirrored: order of its nodes in an image; ideal (2, 2): map to the ideal cell; nodes
    (n, 2), middle (2,): local coordinates; shapes, gradients: of the functions, (k, n) and (k, n, 2) at places (k, 2); outside: by how much places (k, 2) are outside."""

    corners: int
    edges_have_middles: bool
    mirrored: tuple[int, ...]
    ideal: Array
    nodes: Array
    middle: Array
    shapes: Callable[[Array], Array]
    gradients: Callable[[Array], Array]
    outside: Callable[[Array], Array]


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


def triangle_shapes(xi: Array) -> Array:
    """Quadratic shape functions (k, 6) at places (k, 2) in the unit triangle."""
    corner = _linear_shapes(xi)
    return np.concatenate([corner * (2 * corner - 1), 4 * corner * np.roll(corner, -1, axis=1)], axis=1)


def triangle_shape_gradients(xi: Array) -> Array:
    """Their derivatives (k, 6, 2) to the two coordinates."""
    corner, slopes = _linear_shapes(xi)[..., None], _BARYCENTRIC
    of_edges = corner * np.roll(slopes, -1, axis=0) + np.roll(corner, -1, axis=1) * slopes
    return np.concatenate([(4 * corner - 1) * slopes, 4 * of_edges], axis=1)


def _linear_shapes(xi: Array) -> Array:
    return np.stack([1 - xi[:, 0] - xi[:, 1], xi[:, 0], xi[:, 1]], axis=1)


def _linear_gradients(xi: Array) -> Array:
    return np.broadcast_to(_BARYCENTRIC, (len(xi), 3, 2))


def _outside_square(xi: Array) -> Array:
    return np.asarray(np.maximum(np.abs(xi) - 1, 0).max(axis=1))


def _outside_triangle(xi: Array) -> Array:
    # twice, since its sides are half as long as those of the square
    return np.asarray(2 * np.maximum(-_linear_shapes(xi), 0).max(axis=1))


def _node(coordinate: float) -> int:
    return int(coordinate) + 1


def _lagrange(xi: Array) -> Array:
    """Quadratic polynomials (..., 3) that are 1 at -1, 0, 1."""
    return np.stack([xi * (xi - 1) / 2, 1 - xi**2, xi * (xi + 1) / 2], axis=-1)


def _lagrange_slopes(xi: Array) -> Array:
    return np.stack([xi - 0.5, -2 * xi, xi + 0.5], axis=-1)


_THIRD = np.full(2, 1 / 3)
ELEMENTS = {
    "triangle": Element(
        3, False, (0, 2, 1), _EQUILATERAL, TRIANGLE_NODES[:3], _THIRD, _linear_shapes, _linear_gradients, _outside_triangle
    ),
    "triangle6": Element(
        3,
        True,
        (0, 2, 1, 5, 4, 3),
        _EQUILATERAL,
        TRIANGLE_NODES,
        _THIRD,
        triangle_shapes,
        triangle_shape_gradients,
        _outside_triangle,
    ),
    "quad": Element(
        4,
        True,
        (0, 3, 2, 1, 7, 6, 5, 4, 8),
        np.eye(2),
        QUAD_NODES,
        np.zeros(2),
        quad_shapes,
        quad_shape_gradients,
        _outside_square,
    ),
}  # fmt: skip
