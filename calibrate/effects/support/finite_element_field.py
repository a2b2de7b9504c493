"""Displacements of a test solved by finite elements, at any place of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class FieldMesh:
    """A mesh that fields live on, with so many nodes; equal to another one of the same digest. shares: of places (p, 2), mm, the nodes (p, q) around each and their shares (p, q) in its
    displacement, and whether it is in the specimen (p,); what is outside has no meaning. slopes: of places in the specimen the nodes (p, q) and the derivatives
    (p, q, 2), 1/mm, of their shares."""

    digest: bytes
    nodes: int
    shares: Callable[[Array], tuple[Indices, Array, NDArray[np.bool_]]] = field(compare=False, repr=False)
    slopes: Callable[[Array], tuple[Indices, Array]] = field(compare=False, repr=False)


@dataclass(frozen=True, eq=False)
class FiniteElementField:
    """displacements (t, k, 2), mm, of the nodes of a mesh, the first of which are the camera's points."""

    displacements: Array
    mesh: FieldMesh

    def interpolated(self, between: Array) -> FiniteElementField:
        """Of other increments, of which `between` (s, t) has the shares of these."""
        return replace(self, displacements=np.tensordot(between, self.displacements, 1))

    def deformation_gradients(self, places: Array) -> Array:
        """(t, p, 2, 2) at places (p, 2), mm."""
        nodes, slopes = self.mesh.slopes(places)
        return np.eye(2) + np.einsum("pqj,tpqi->tpij", slopes, self.displacements[:, nodes])
