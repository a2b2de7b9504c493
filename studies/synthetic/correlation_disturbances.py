"""What a correlation gets wrong: means over subsets, an edge not measured, a reference picture of a bent specimen.

In: an exact solution and a mesh of the camera. Out: small classes with their amplitudes, see `studies.synthetic.disturbances`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from forward.solution import SurfaceSolution
from meshes import Specimen
from studies.synthetic.disturbances import Disturbance
from studies.synthetic.specimen_edges import inside, inward

Array = NDArray[np.float64]
PIXELS = 12  # along the side of a subset that an edge cuts; even, so that none lies on an edge through its middle


@dataclass(frozen=True)
class SubsetSmoothing(Disturbance):
    """A displacement is fitted to those over a square of `side`, mm, cut off at the specimen's edges.

    affine: the subset may strain (a plane is fitted and read at its middle), as in most programs; else the mean is
    taken, which near an edge belongs to another point. Inside both are the same. Whole subsets are summed over 5 x 5
    Gauss points, those that an edge cuts over the centres of `PIXELS` x `PIXELS` cells.
    """

    side: float
    affine: bool = True
    name: ClassVar[str] = "subset smoothing"

    def displacements(self, solution, specimen, X):
        x, w = np.polynomial.legendre.leggauss(5)
        whole = inside(specimen, (X[:, None] + self._offsets(np.linspace(-1, 1, 9))).reshape(-1, 2))
        whole = whole.reshape(len(X), -1).all(axis=1)
        cells = (2 * np.arange(PIXELS) + 1) / PIXELS - 1
        result = np.empty((len(solution.displacements), *X.shape))
        for nodes, at, weights in (
            (np.flatnonzero(whole), x, np.outer(w, w).ravel()),
            (np.flatnonzero(~whole), cells, np.ones(PIXELS**2)),
        ):
            if len(nodes):
                result[:, nodes] = self._read(solution, specimen, X[nodes], self._offsets(at), weights)
        return result

    def _offsets(self, at: Array) -> Array:
        """Places (q^2, 2), mm, from the middle of a subset; at (q,): from -1 to 1."""
        return 0.5 * self.side * np.array([(a, b) for a in at for b in at])

    def _read(self, solution: SurfaceSolution, specimen: Specimen, X: Array, offsets: Array, weights: Array) -> Array:
        """Displacements (t, n, 2) fitted over the places that lie in the specimen."""
        places = X[:, None] + offsets
        weights = weights * inside(specimen, places.reshape(-1, 2)).reshape(len(X), -1)
        there = weights > 0
        basis = np.concatenate([np.ones((len(offsets), 1)), offsets / self.side], axis=1)[:, : 3 if self.affine else 1]
        gram = np.einsum("nq,qa,qb->nab", weights, basis, basis)
        row = np.linalg.solve(gram, np.eye(basis.shape[1])[:1].T)[..., 0]
        row = np.einsum("na,qa,nq->nq", row, basis, weights)
        owner = np.repeat(np.arange(len(X)), there.sum(axis=1))
        average = sp.csr_array((row[there], (owner, np.arange(len(owner)))), shape=(len(X), len(owner)))
        return np.array([average @ u for u in solution.evaluate(places[there])])

    def label(self):
        return {
            "name": self.name,
            "amplitudes": {"s2": self.side**2 / 12},
            "shape": {},
            "side": self.side,
            "affine": self.affine,
        }


@dataclass(frozen=True)
class UnmeasuredStrip(Disturbance):
    """The measured region ends w, mm, inside the free edges; the nodes further inside make room smoothly."""

    w: float
    name: ClassVar[str] = "unmeasured strip"

    def points(self, mesh):
        return mesh.points + self.w * inward(mesh)


@dataclass(frozen=True)
class Warp(Disturbance):
    """A specimen that was bent in the reference picture, and is flat in all others.

    Along axis (0: x, 1: y) it had the height z = h exp(-(s - place)^2 / (2 width^2)) over its length s, mm; slope is the
    steepest inclination, rad. Seen from above its points are at the integral of the cosine of the inclination.
    """

    axis: int
    slope: float
    place: float
    width: float
    name: ClassVar[str] = "initial warp"

    def inclination(self, s: Array) -> Array:
        """Angle, rad, at lengths s, mm, from the middle."""
        x = (s - self.place) / self.width
        return self.slope * x * np.exp(0.5 - 0.5 * x**2)

    def before(self, x):
        s = np.linspace(x[:, self.axis].min(), x[:, self.axis].max(), 2001)
        lost = CubicSpline(s, 1 - np.cos(self.inclination(s))).antiderivative()
        seen = x.copy()
        seen[:, self.axis] -= lost(x[:, self.axis]) - lost(0.0)
        return seen

    def label(self):
        return {"name": self.name, "amplitudes": {}, "shape": {}, **asdict(self)}
