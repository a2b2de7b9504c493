"""Triangles in blocks: what acts in every triangle for itself is run block by block, so that memory does not grow with the Experiment.

In: an Experiment as arrays and its virtual fields. Out: `Block`s of equal size, each with all increments, so that the history of a place stays
together. Only rows of virtual work are kept of a block.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.effects.support.effect_data import Data
from calibrate.equations.equilibrium import virtual_work

Array = NDArray[np.float64]
BYTES = 8e6  # of one tensor in all increments of a block
OF_ONE_SIZE = 256  # triangles by which blocks differ, so that other tests find laws compiled
OF_TRIANGLES = ("triangles", "stencil", "slopes", "areas", "centroids", "edges", "edge_nodes", "beside")


@dataclass(frozen=True, eq=False)
class Block:
    """Some triangles. used: how many of them are its own; the last one is repeated behind, without virtual work, so that all blocks are of
    one size. places (b,): which they are; own: what an Experiment knows of them (`Data`); virtual (v, 2 b): thickness x area x gradient of each
    virtual field, mm^2."""

    places: NDArray[np.int64]
    used: int
    own: dict[str, Any]
    virtual: sp.csc_array

    def of(self, data: Data) -> Data:
        """The Experiment with these triangles alone."""
        return replace(data, **self.own)

    def work(self, stress: Any) -> Array:
        """Virtual work (..., t, 2 v), N, of stresses (..., t, b, 2, 2)."""
        return virtual_work(self.virtual, stress)

    def dual(self, forces: Array) -> Array:
        """Stresses (t, b, 2, 2) whose product with others is the work of these with forces (t, 2 v), N."""
        t = len(forces)
        flat = self.virtual.T @ np.moveaxis(forces.reshape(t, 2, -1), -1, 0).reshape(-1, 2 * t)
        return np.ascontiguousarray(np.moveaxis(flat.reshape(-1, 2, t, 2), (2, 3), (0, 2)))


def blocks(data: Data, virtual: sp.csr_array, most: float = BYTES, of_one_size: int = OF_ONE_SIZE) -> tuple[Block, ...]:
    """All triangles of virtual fields (v, 2 m), in as few blocks as `most` bytes a tensor allow, whose sizes are multiples of `of_one_size`, of fewer triangles a power of two."""
    m = virtual.shape[1] // 2
    count = max(1, int(np.ceil(m * len(data.u) * 32 / most)))
    multiple = min(of_one_size, 2 ** int(np.ceil(np.log2(m))))
    size = multiple * int(np.ceil(m / count / multiple))
    columns = sp.csc_array(virtual)
    return tuple(_block(data, columns, np.arange(first, first + size)) for first in range(0, m, size))


def whole(data: Data, virtual: sp.csr_array) -> tuple[Block, ...]:
    """All triangles in one block, and none of them twice: for what looks at its neighbours."""
    return blocks(data, virtual, np.inf, 1)


def _block(data: Data, virtual: sp.csc_array, places: NDArray[np.int64]) -> Block:
    m = virtual.shape[1] // 2
    used, repeated = int((places < m).sum()), np.minimum(places, m - 1)
    inside = virtual[:, 2 * places[0] : 2 * (places[0] + used)]
    padding = sp.csc_array((virtual.shape[0], 2 * (len(places) - used)))
    own = {name: jnp.asarray(np.asarray(getattr(data, name))[repeated]) for name in OF_TRIANGLES}
    return Block(repeated, used, own, sp.csc_array(sp.hstack([inside, padding])))
