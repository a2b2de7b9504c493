"""Displacements of a test solved by finite elements, at any place of it, and what subsets of a correlation read of them.

In: displacements of the nodes, and shares of the nodes at any places. Out: for squares of several sides what a plane, fitted over the part of a square that lies
in the specimen and read at its middle, differs by from the displacement there. Nothing is cut off after some order, and no derivative is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
CELLS = 12  # along the side of a square that an edge cuts
GAUSS = 4  # points along the side of a whole one
REACH = 0.75  # of its side, within which no edge cuts a square: its half diagonal, and what edges are curved by
STEP = np.sqrt(2.0)  # between two sides
LARGEST = 8  # sides; from half the distance of the points to 5.7 times of it
AT_ONCE = 300_000  # places


@dataclass(frozen=True, eq=False)
class FiniteElementField:
    """displacements (t, k, 2), mm, of the nodes, the first of which are the camera's points. shares: of places (p, 2), mm, the nodes (p, q) around each and their
    shares (p, q) in its displacement, and whether it is in the specimen (p,); what is outside has no meaning."""

    displacements: Array
    shares: Callable[[Array], tuple[Indices, Array, NDArray[np.bool_]]]

    def interpolated(self, between: Array) -> FiniteElementField:
        """Of other increments, of which `between` (s, t) has the shares of these."""
        return FiniteElementField(np.tensordot(between, self.displacements, 1), self.shares)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Subsets:
    """What squares of several sides (k,), mm, read too much: readings (k, t, n, 2), mm, over the variance side^2 / 12, 1/mm.
    doubt, the same: a standard deviation of them, one pattern everywhere."""

    sides: jax.Array
    readings: jax.Array
    doubt: jax.Array

    def doubted(self) -> Subsets:
        """The same, wrong by a standard deviation."""
        return replace(self, readings=self.readings + self.doubt)

    def at(self, side: jax.Array) -> jax.Array:
        """(t, n, 2), 1/mm, of one side, mm: linear in its logarithm; of a side outside of the range that of its end."""
        last = len(self.sides) - 1
        place = jnp.clip(jnp.log(side / self.sides[0]) / np.log(STEP), 0.0, last)
        below = jnp.clip(jnp.floor(place).astype(int), 0, last - 1)
        share = place - below
        return (1 - share) * self.readings[below] + share * self.readings[below + 1]


def sides(pitch: float) -> Array:
    """(k,) mm, for points that are `pitch`, mm, apart."""
    return 0.5 * pitch * STEP ** np.arange(LARGEST)


def subset_readings(field: FiniteElementField, points: Array, distances: Array, side: float) -> Array:
    """(t, n, 2), 1/mm: reading at each point less the displacement there, over side^2 / 12; distances (n,), mm, of points (n, 2) from the edges."""
    whole = distances > REACH * side
    found = np.empty((len(field.displacements), *points.shape))
    x, w = np.polynomial.legendre.leggauss(GAUSS)
    cells = (2 * np.arange(CELLS) + 1) / CELLS - 1
    for which, at, weights, variance in (
        (np.flatnonzero(whole), x, np.outer(w, w).ravel(), 1.0),
        (np.flatnonzero(~whole), cells, np.ones(CELLS**2), 1 - 1 / CELLS**2),
    ):
        offsets = 0.5 * side * np.array([(a, b) for a in at for b in at])
        for some in np.array_split(which, int(np.ceil(len(which) * len(offsets) / AT_ONCE)) or 1):
            read = _operator(field, points[some], offsets, weights) @ _flat(field.displacements)
            change = _tall(read, len(field.displacements)) - field.displacements[:, some]
            found[:, some] = change / (variance * side**2 / 12)
    return found


def _operator(field: FiniteElementField, points: Array, offsets: Array, weights: Array) -> sp.csr_array:
    """(k, nodes): reading at points (k, 2) of squares with weights (q,) at offsets (q, 2)."""
    n, q = len(points), len(offsets)
    nodes, shares, inside = field.shares((points[:, None] + offsets).reshape(-1, 2))
    used = weights * inside.reshape(n, q)
    basis = np.concatenate([np.ones((q, 1)), offsets], axis=1)
    gram = np.einsum("nq,qa,qb->nab", used, basis, basis)
    row = np.linalg.solve(gram, np.broadcast_to(np.eye(3)[:, :1], (n, 3, 1)))[..., 0]
    row = (np.einsum("na,qa->nq", row, basis) * used).reshape(-1, 1) * np.where(inside[:, None], shares, 0.0)
    owner = np.repeat(np.arange(n), q * nodes.shape[1])
    return sp.csr_array(
        sp.coo_array((row.ravel(), (owner, nodes.ravel())), shape=(n, field.displacements.shape[1]))
    )


def _flat(displacements: Array) -> Array:
    """(k, 2 t) of (t, k, 2)."""
    return np.moveaxis(displacements, 1, 0).reshape(displacements.shape[1], -1)


def _tall(flat: Array, t: int) -> Array:
    """(t, k, 2) of (k, 2 t)."""
    return np.moveaxis(flat.reshape(len(flat), t, 2), 1, 0)
