"""What the twin of a test knows of its kinematics that the camera's triangles do not: readings of subsets, deformation gradients at free edges, and the bend over
the thickness.

In: the field of the twin between the camera's points (`FiniteElementField`). Out: `TwinKinematics`, arrays that effects read.

Readings: for squares of several sides what a plane, fitted over the part of a square that lies in the specimen and read at its middle, differs by from the
displacement there. Nothing is cut off after some order, and no derivative is taken.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.effects.support.digest import digest
from calibrate.effects.support.finite_element_field import FieldMesh, FiniteElementField

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
CELLS = 12  # along the side of a square that an edge cuts
GAUSS = 4  # points along the side of a whole one
REACH = 0.75  # of its side, within which no edge cuts a square: its half diagonal, and what edges are curved by
STEP = np.sqrt(2.0)  # between two sides
SIDES = 8  # from half the distance of the points to 5.7 times of it
SINGULAR = 1e9  # condition of the normal equations of a plane
AT_ONCE = 300_000  # places
ALONG = 4  # Gauss points along a free edge
WITHIN = 1e-3  # share of the way to the centroid by which they are inside


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Subsets:
    """What squares of several sides (k,), mm, read too much: readings (k, t, n, 2), mm, over the variance side^2 / 12, 1/mm.
    doubt, the same: a standard deviation of them, one pattern everywhere."""

    sides: Any
    readings: Any
    doubt: Any

    def doubted(self) -> Subsets:
        """The same, wrong by a standard deviation."""
        return replace(self, readings=self.readings + self.doubt)

    def at(self, side: Any) -> Any:
        """(t, n, 2), 1/mm, of one side, mm: linear in its logarithm; of a side outside of the range that of its end."""
        last = len(self.sides) - 1
        place = jnp.clip(jnp.log(side / self.sides[0]) / np.log(STEP), 0.0, last)
        below = jnp.clip(jnp.floor(place).astype(int), 0, last - 1)
        share = place - below
        return (1 - share) * self.readings[below] + share * self.readings[below + 1]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Bend:
    """error (t, n, 2), 1/mm: what the camera's triangles miss of the bend over the thickness, see `finite_thickness.bend_errors`; of_means: the same with
    gradients at the nodes that are means of those around."""

    error: Any
    of_means: Any


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class TwinKinematics:
    """missed (2, t, e, 2, 2): what the camera's deformation gradients at the centroids, and in the mean over a free edge, lack in the triangles beside one, in the order
    of `Data.beside`. doubt: the share of it that may be wrong. bend: None without a thickness."""

    subsets: Subsets
    missed: Any
    doubt: float = field(default=0.0, metadata={"static": True})
    bend: Bend | None = None

    def doubted(self) -> TwinKinematics:
        """The same, wrong by a standard deviation, but for the bend, of which the formula itself is in doubt (`finite_thickness.NEXT_ORDER`): with a share of what triangles
        miss of it the deviations of thicknesses would be up to four times as large."""
        return replace(self, subsets=self.subsets.doubted(), missed=(1 + self.doubt) * self.missed)

    def of_mean_gradients(self) -> TwinKinematics:
        """The same for triangles whose gradients at the nodes are means of those around."""
        return self if self.bend is None else replace(self, bend=Bend(self.bend.of_means, self.bend.of_means))

    def of_increments(self, some: slice) -> TwinKinematics:
        """Of some increments alone, without subsets."""
        return replace(self, missed=self.missed[:, some])


def sides_of_subsets(pitch: float) -> Array:
    """(k,) mm, for points that are `pitch`, mm, apart."""
    return 0.5 * pitch * STEP ** np.arange(SIDES)


def subset_readings(twin: FiniteElementField, points: Array, distances: Array, side: float) -> Array:
    """(t, n, 2), 1/mm: reading at each point less the displacement there, over side^2 / 12; distances (n,), mm, of points (n, 2) from the edges."""
    found, flat = np.empty((len(twin.displacements), *points.shape)), _flat(twin.displacements)
    for some, operator, told, variance in _operators(_Squares(twin.mesh, points, distances, side)):
        change = _tall(operator @ flat, len(twin.displacements)) - twin.displacements[:, some]
        found[:, some] = np.where(told[:, None], change, 0.0) / (variance * side**2 / 12)
    return found


@dataclass(frozen=True)
class _Squares:
    """Squares of a side, mm, around points (n, 2) of a mesh, equal to others of the same."""

    mesh: FieldMesh
    points: Array = field(compare=False)
    distances: Array = field(compare=False)
    side: float
    digest: bytes = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "digest", digest(self.points, self.distances))


@lru_cache(maxsize=SIDES)
def _operators(of: _Squares) -> list[tuple[Indices, sp.csr_array, NDArray[np.bool_], float]]:
    """Some of the points (k,), readings of squares around them (k, nodes), whether there are any (k,), and the variance of a square over side^2 / 12; all points in
    all of these. Kept, as a diagnosis has several twins on the same mesh."""
    whole, found = of.distances > REACH * of.side, []
    x, w = np.polynomial.legendre.leggauss(GAUSS)
    cells = (2 * np.arange(CELLS) + 1) / CELLS - 1
    for which, at, weights, variance in (
        (np.flatnonzero(whole), x, np.outer(w, w).ravel(), 1.0),
        (np.flatnonzero(~whole), cells, np.ones(CELLS**2), 1 - 1 / CELLS**2),
    ):
        offsets = 0.5 * of.side * np.array([(a, b) for b in at for a in at])
        parts = int(np.ceil(len(which) * len(offsets) / AT_ONCE))
        for some in np.array_split(which, parts) if parts else ():
            found.append((some, *_operator(of.mesh, of.points[some], offsets, weights), variance))
    return found


def _operator(mesh: FieldMesh, points: Array, offsets: Array, weights: Array) -> tuple[sp.csr_array, NDArray[np.bool_]]:
    """(k, nodes): reading at points (k, 2) of squares with weights (q,) at offsets (q, 2); and where enough of a square is in the specimen for a plane (k,)."""
    n, q = len(points), len(offsets)
    nodes, shares, inside = mesh.shares((points[:, None] + offsets).reshape(-1, 2))
    used = weights * inside.reshape(n, q)
    basis = np.concatenate([np.ones((q, 1)), offsets / np.abs(offsets).max()], axis=1)
    gram = np.einsum("nq,qa,qb->nab", used, basis, basis)
    told = np.linalg.cond(gram) < SINGULAR
    gram[~told] = np.eye(3)
    row = np.linalg.solve(gram, np.broadcast_to(np.eye(3)[:, :1], (n, 3, 1)))[..., 0]
    row = (np.einsum("na,qa->nq", row, basis) * used).reshape(-1, 1) * np.where(inside[:, None], shares, 0.0)
    owner = np.repeat(np.arange(n), q * nodes.shape[1])
    return sp.csr_array(sp.coo_array((row.ravel(), (owner, nodes.ravel())), shape=(n, mesh.nodes))), told


def _flat(displacements: Array) -> Array:
    """(k, 2 t) of (t, k, 2)."""
    return np.moveaxis(displacements, 1, 0).reshape(displacements.shape[1], -1)


def _tall(flat: Array, t: int) -> Array:
    """(t, k, 2) of (k, 2 t)."""
    return np.moveaxis(flat.reshape(len(flat), t, 2), 1, 0)


def edge_gradients(twin: FiniteElementField, points: Array, centroids: Array, ends: Array) -> Array:
    """(2, t, k, 2, 2) of triangles beside a free edge: at their centroids (k, 2), mm, and the mean over the edge between two of the points, ends (k, 2)."""
    start, end = points[ends[:, 0]], points[ends[:, 1]]
    x, w = np.polynomial.legendre.leggauss(ALONG)
    along = [start + 0.5 * (1 + one) * (end - start) for one in x]
    of_edge = [twin.deformation_gradients(one + WITHIN * (centroids - one)) for one in along]
    return np.stack([twin.deformation_gradients(centroids), np.tensordot(0.5 * w, np.stack(of_edge), 1)])
