"""What recovered kinematics may still miss, as sources that act alike in every increment.

In: the equations of an Experiment and a material. Out: sources (`weights.Sources`): change of the residual when one correction
that `recovery` makes, of an edge or a curved segment, is wrong by its own size; and what a twin leaves of them.

A discretisation error is no noise: it grows with the load and keeps its pattern, so that it would pass for an effect.
Its standard deviation is taken to be the correction itself, which is of lower order and so on the safe side, three times:
independent between edges, common to neighbours within a spacing of the virtual fields, and common to all. The covariance
is sources . sources^T. On clean data the residual of the true material is well below it, so that the score of an effect
that is not there stays low however small the noise.

Where a finite-element replay of the test tells the error itself (`calibrate.diagnosis.twin`), it is subtracted, and only a remainder is allowed
for: a share `REMAINDER` of that error as a whole, and of each source.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import lapack

from calibrate.data.load_path import turning_points
from calibrate.data.triangulation import unique_edges
from calibrate.equations import kinematics, recovery
from calibrate.equations.basis import Basis, nominal_stress, tangent_modulus
from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.weights import Sources

Array = NDArray[np.float64]
NEGLIGIBLE = 1e-6  # variance that is left of an equation, over the largest of any
KEPT = 0.99  # share of the squared corrections; the smallest are left out
REMAINDER = 0.2  # of a discretisation error, that a twin misses: docs/discover_method.md, "Weights"


def edge_operators(system: Equilibrium) -> tuple[sp.csr_array, sp.csr_array]:
    """Nodal values to the correction in the middle of each edge (e, n), and that to gradients at centroids (2 m, e)."""
    points, triangles = system.experiment.points, system.experiment.triangles
    edges, number = unique_edges(triangles)
    slopes, m = kinematics.shape_gradients(points, triangles)[0], len(triangles)
    recovered = recovery.nodal_gradients(points, triangles)
    i, j = edges.T
    length = (points[j] - points[i]) / 8
    middle = sum(sp.diags_array(length[:, k]) @ (recovered[k][i] - recovered[k][j]) for k in range(2))
    rows = np.concatenate([2 * np.arange(m) + k for _ in range(3) for k in range(2)])
    columns = np.concatenate([number[a] for a in range(3) for _ in range(2)])
    values = np.concatenate([-4 / 3 * slopes[:, (a + 2) % 3, k] for a in range(3) for k in range(2)])
    return sp.csr_array(middle), sp.csr_array((values, (rows, columns)), shape=(2 * m, len(edges)))


def correction_variances(system: Equilibrium, basis: Basis, c: Array, increment: int) -> Array:
    """Variance (2 v,), N^2, of the residuals of one increment where the correction of every edge is wrong by its own size, independently."""
    middle, to_gradient = edge_operators(system)
    correction = middle @ system.experiment.displacements[increment]
    tensor = tangent_modulus(basis, system.deformation_gradients[increment], c)
    work = [[system.virtual_gradients @ _modulus(tensor, i, k) @ to_gradient for k in range(2)] for i in range(2)]
    return np.concatenate(
        [sum(sp.csr_array(row[k]).power(2) @ correction[:, k] ** 2 for k in range(2)) for row in work]
    )


def _modulus(tensor: Array, i: int, k: int) -> sp.csr_array:
    """Block-diagonal (2 m, 2 m) of a tangent (m, 2, 2, 2, 2): stress of component i by gradients of displacements k."""
    m = len(tensor)
    rows = np.repeat(np.arange(2 * m), 2)
    columns = np.tile(np.arange(2 * m).reshape(m, 1, 2), (1, 2, 1)).ravel()
    return sp.csr_array((tensor[:, i, :, k, :].ravel(), (rows, columns)), shape=(2 * m, 2 * m))


@dataclass(frozen=True, eq=False)
class Corrections:
    """Corrections of the recovery, the smallest of them left out: middle (e, n), to_gradient (2 m, e) as of `edge_operators`; curved (q,):
    triangles with a curved edge, and segments (q,): share of the segment in their area."""

    system: Equilibrium
    middle: sp.csr_array
    to_gradient: sp.csr_array
    edges: Array
    curved: NDArray[np.int64]
    segments: Array

    @classmethod
    def of(cls, system: Equilibrium) -> Corrections:
        """Of an Experiment."""
        experiment = system.experiment
        middle, to_gradient = edge_operators(system)
        size = np.sum([((middle @ u) ** 2).sum(axis=1) for u in experiment.displacements], axis=0)
        order = np.argsort(size)[::-1]
        kept = np.sort(order[: np.searchsorted(np.cumsum(size[order]), KEPT * size.sum()) + 1])
        plain = kinematics.shape_gradients(experiment.points, experiment.triangles)[1]
        share = (system.areas - plain) / system.areas
        curved = np.flatnonzero(share)
        own = sp.csr_array(sp.csc_array(to_gradient)[:, kept])
        return cls(system, sp.csr_array(middle[kept]), own, edge_middles(system)[kept], curved, share[curved])

    @property
    def kinds(self) -> NDArray[np.int64]:
        """(s,) of each source: 0 an edge, of displacements along x, then along y, 1 a curved segment."""
        return np.repeat([0, 1], [2 * len(self.edges), len(self.curved)])

    @property
    def groups(self) -> NDArray[np.int64]:
        """(s,): number of the place, a spacing of the virtual fields wide, and kind of each source."""
        points, triangles = self.system.experiment.points, self.system.experiment.triangles
        places = np.concatenate([self.edges, self.edges, points[triangles[self.curved]].mean(axis=1)])
        cell = np.floor(places / self.system.fields.spacing).astype(np.int64)
        return np.unique(np.column_stack([self.kinds, cell]), axis=0, return_inverse=True)[1].ravel()

    def sources(self, basis: Basis, c: Array, increment: int) -> sp.csr_array:
        """(2 v, s), N: change of the residual of an increment when one of them is wrong by its own size."""
        system, m = self.system, len(self.system.areas)
        F = system.deformation_gradients[increment]
        tensor, correction = tangent_modulus(basis, F, c), self.middle @ system.experiment.displacements[increment]
        stress = nominal_stress(basis, F, c)[self.curved] * self.segments[:, None, None]
        q = len(self.curved)
        pick = (2 * self.curved[:, None] + np.arange(2)).ravel(), np.repeat(np.arange(q), 2)
        rows = []
        for i in range(2):
            blocks = [
                system.virtual_gradients @ _modulus(tensor, i, k) @ self.to_gradient @ sp.diags_array(correction[:, k])
                for k in range(2)
            ]
            segment = sp.csr_array((stress[:, i].ravel(), pick), shape=(2 * m, q))
            rows.append(sp.hstack([*blocks, system.virtual_gradients @ segment]))
        return sp.csr_array(sp.vstack(rows))


def sources(system: Equilibrium, basis: Basis, c: Array) -> Sources:
    """Sources at the material with coefficients c (n,): a few that have the covariance of all.

    They are smooth in the load, so that they are taken at turning points and interpolated between (`turning_points`).
    """
    corrections = Corrections.of(system)
    chosen, shares = turning_points(system.experiment.displacements)
    single = sp.csr_array(sp.vstack([corrections.sources(basis, c, int(i)) for i in chosen]))
    covariance = (single @ single.T).toarray()
    for group in (corrections.groups, corrections.kinds):
        together = single @ np.eye(group.max(initial=0) + 1)[group]
        covariance += together @ together.T
    columns = _root(covariance)
    return Sources(((columns.reshape(len(chosen), len(columns) // len(chosen), columns.shape[1]), shares),))


def _root(covariance: Array) -> Array:
    """Columns (r, k), as many as it has a rank, whose products make a covariance (r, r): Cholesky with pivots (LAPACK's dpstrf)."""
    lower, order, rank, _ = lapack.dpstrf(covariance, lower=1, tol=NEGLIGIBLE * covariance.diagonal().max(initial=0.0))
    columns = np.zeros((len(covariance), rank))
    columns[order - 1] = np.tril(lower)[:, :rank]
    return columns


def remainder(system: Equilibrium, basis: Basis, c: Array, twin: Array) -> Sources:
    """Sources of what is left once the residual of a twin (t, 2 v), N, is subtracted."""
    return sources(system, basis, c).beside(Sources.of(twin[..., None])).scaled(REMAINDER)


def edge_middles(system: Equilibrium) -> Array:
    """(e, 2) mm, in the order of `edge_operators`."""
    points, triangles = system.experiment.points, system.experiment.triangles
    return points[unique_edges(triangles)[0]].mean(axis=1)
