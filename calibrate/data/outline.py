"""The outline of an Experiment: which of its edges are held by a grip, free, or the rim of the measured region.

In: an Experiment. Out: `Outline`, every edge of outline and holes with what it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.data.triangulation import boundary_edges

Indices = NDArray[np.int64]
NO_GRIP = -1


@dataclass(frozen=True, eq=False)
class Outline:
    """edges (k, 2), the specimen on their left; owners (k,): their triangles; grip (k,): number of the loaded boundary, or -1; free (k,); given (k,): true edges that the
    user gave, so that the specimen ends there.

    An edge is a grip's if both ends are its nodes, free if both ends are free or gripped and one is free. The rest is the rim:
    its traction is unknown.
    """

    edges: Indices
    owners: Indices
    grip: Indices
    free: NDArray[np.bool_]
    given: NDArray[np.bool_]

    @classmethod
    def of(cls, experiment: Experiment) -> Outline:
        """Of the triangles of an Experiment."""
        edges, owners = boundary_edges(experiment.triangles)
        grip, gripped = np.full(len(edges), NO_GRIP), np.zeros(edges.shape, bool)
        for i, boundary in enumerate(experiment.loaded):
            on = np.isin(edges, boundary.nodes)
            grip[on.all(axis=1) & (grip == NO_GRIP)] = i
            gripped |= on
        free = np.isin(edges, experiment.free_nodes)
        given = np.isin(edges, experiment.given_rims).all(axis=1)
        return cls(edges, owners, grip, (free | gripped).all(axis=1) & free.any(axis=1), given)

    @property
    def rim(self) -> Indices:
        """Edges (r, 2) that are neither a grip's nor free."""
        return self.edges[(self.grip == NO_GRIP) & ~self.free]
