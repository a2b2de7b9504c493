"""Edges of the measured region as a subset sees them: a mesh in, the nearest edge lines of every node out.

Two lines a node suffice for a smooth edge, a corner between edge and grip, or a narrow ligament. Subset moments: what a
plane, fitted over the part of a square that lies in the specimen and read at its middle, makes of a quadratic field.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.data.triangulation import boundary_edges
from calibrate.equations.recovery import SMOOTH
from meshes.measured.curved_outline import is_smooth

Array = NDArray[np.float64]
CELLS = 16  # along the side of a subset
FACED = 0.9
AT_ONCE = 1000  # points
OTHER = 0.7  # cosine of normals below which the second line belongs to another edge


def nearest_lines(points: Array, triangles: NDArray[np.int64]) -> Array:
    """(n, 2, 4): distance, mm, outward normal (x, y) and curvature, 1/mm, of the nearest boundary edge of each node, and of
    the nearest one of another direction. Curvature is positive around holes."""
    start, end = boundary_edges(triangles)[0].T  # the specimen is on the left
    along = points[end] - points[start]
    length = np.linalg.norm(along, axis=1)
    tangent = along / length[:, None]
    normal = np.column_stack([tangent[:, 1], -tangent[:, 0]])
    follower = np.full(len(points), -1)
    follower[start] = np.arange(len(start))
    after = follower[end]
    turn = np.arctan2(
        tangent[:, 0] * tangent[after, 1] - tangent[:, 1] * tangent[after, 0], (tangent * tangent[after]).sum(axis=1)
    )
    at_end = np.where(is_smooth(turn, after, SMOOTH), -2 * turn / (length + length[after]), 0.0)
    at_start = np.zeros(len(start))
    at_start[after] = at_end
    curvature = 0.5 * (at_start + at_end)
    parts = [_nearest(some, points, start, tangent, normal, length, curvature) for some in _in_parts(points)]
    return np.concatenate(parts)


def _in_parts(points: Array) -> list[Array]:
    """Points (n, 2), so few at a time that their distances to all edges need little memory."""
    return np.array_split(points, int(np.ceil(len(points) / AT_ONCE)))


def _nearest(
    some: Array,
    points: Array,
    start: NDArray[np.int64],
    tangent: Array,
    normal: Array,
    length: Array,
    curvature: Array,
) -> Array:
    """(k, 2, 4) of some points (k, 2), mm: see `nearest_lines`; edges (e,) with their tangents and normals (e, 2), lengths and curvatures (e,)."""
    x, y = (some[:, None, i] - points[start, i] for i in range(2))
    place = np.clip(x * tangent[:, 0] + y * tangent[:, 1], 0, length)
    far = np.sqrt((x - place * tangent[:, 0]) ** 2 + (y - place * tangent[:, 1]) ** 2)
    height = (points[start] * normal).sum(axis=1) - some @ normal.T
    faced = height >= FACED * far  # the foot is on the edge, and the node on its inner side
    nodes, nearest = np.arange(len(some)), far.argmin(axis=1)
    apart = np.where((normal @ normal.T)[nearest] < OTHER, far, np.inf)
    other = np.where(faced, apart, np.inf).argmin(axis=1)
    result = np.zeros((len(some), 2, 4))
    for k, edge in enumerate((nearest, other)):
        result[:, k, 0] = far[nodes, edge]
        result[:, k, 1:3] = normal[edge]
        result[:, k, 3] = curvature[edge]
    gap = points[start[nearest]] + place[nodes, nearest][:, None] * tangent[nearest] - some
    off = result[:, 0, 0] > 1e-6 * length[nearest]  # beside a curved edge the foot tells the direction, not the chord
    result[off, 0, 1:3] = gap[off] / result[off, 0, :1]
    result[~np.isfinite(np.where(faced, apart, np.inf).min(axis=1)), 1] = 1e6, 1.0, 0.0, 0.0
    return result


@jax.jit
def subset_moments(lines: Any, side: Any) -> Any:
    """(n, 2, 2), 1: reading at the middle of a subset over its variance side^2 / 12, for x_i x_j; the unit tensor inside.

    lines (n, 2, 4): see `nearest_lines`, side: mm."""
    at = (2 * jnp.arange(CELLS) + 1) / CELLS - 1
    offsets = jnp.stack([x.ravel() for x in jnp.meshgrid(at, at, indexing="ij")], axis=1)  # in half sides
    basis = jnp.concatenate([jnp.ones((len(offsets), 1)), offsets], axis=1)
    squares = offsets[:, :, None] * offsets[:, None, :]

    def one(line):
        weight = jnp.ones(len(offsets))
        for distance, nx, ny, curvature in line:
            outward, across = offsets @ jnp.stack([nx, ny]), offsets @ jnp.stack([-ny, nx])
            height = 2 * distance / side - outward + 0.25 * side * curvature * across**2  # in half sides
            weight = weight * jnp.clip(0.5 + 0.5 * CELLS * height, 0.0, 1.0)
        gram = jnp.einsum("q,qa,qb->ab", weight, basis, basis)
        row = jnp.linalg.solve(gram, jnp.array([1.0, 0.0, 0.0]))
        return jnp.einsum("a,qa,q,qij->ij", row, basis, weight, squares)

    whole = (1 - 1 / CELLS**2) / 3  # of the cell centres
    return jax.lax.map(one, lines, batch_size=256) / whole
