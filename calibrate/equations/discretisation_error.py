"""What recovered kinematics may still miss, as sources that act alike in every increment.

In: the equations of an Experiment and a material. Out: sources (t, 2 v, s), N: change of the residual when one correction
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

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.data.triangulation import unique_edges
from calibrate.equations import kinematics, recovery
from calibrate.equations.basis import Basis
from calibrate.equations.equilibrium import Equilibrium, tangent_modulus

Array = NDArray[np.float64]
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


def sources(system: Equilibrium, basis: Basis, c: Array) -> Array:
    """Sources (t, 2 v, s), N, at the material with coefficients c (n,)."""
    experiment, m = system.experiment, len(system.areas)
    middle, to_gradient = edge_operators(system)
    size = np.sum([((middle @ u) ** 2).sum(axis=1) for u in experiment.displacements], axis=0)
    order = np.argsort(size)[::-1]
    kept = np.sort(order[: np.searchsorted(np.cumsum(size[order]), KEPT * size.sum()) + 1])
    middle, to_gradient = sp.csr_array(middle[kept]), sp.csr_array(sp.csc_array(to_gradient)[:, kept])
    plain = kinematics.shape_gradients(experiment.points, experiment.triangles)[1]
    share = (system.areas - plain) / system.areas
    curved = np.flatnonzero(share)
    pick = (2 * curved[:, None] + np.arange(2)).ravel(), np.repeat(np.arange(len(curved)), 2)
    result = []
    for F, u in zip(system.deformation_gradients, experiment.displacements, strict=True):
        tensor, correction = tangent_modulus(basis, F, c), middle @ u
        P, local = basis.local(F)
        stress = np.einsum("mqij,mq->mij", P, c[local])[curved] * share[curved][:, None, None]
        blocks = []
        for i in range(2):
            parts = []
            for k in range(2):
                work = system.virtual_gradients @ _modulus(tensor, i, k) @ to_gradient
                parts.append(work.toarray() * correction[:, k])
            segment = sp.csr_array((stress[:, i].ravel(), pick), shape=(2 * m, len(curved)))
            blocks.append(np.hstack([*parts, (system.virtual_gradients @ segment).toarray()]))
        result.append(np.concatenate(blocks))
    single = np.array(result)
    places = np.concatenate(
        [
            edge_middles(system)[kept],
            edge_middles(system)[kept],
            experiment.points[experiment.triangles[curved]].mean(axis=1),
        ]
    )
    cell = np.floor(places / system.fields.spacing).astype(np.int64)
    kind = np.repeat([0, 0, 1], [middle.shape[0], middle.shape[0], len(curved)])
    groups = np.unique(np.column_stack([kind, cell]), axis=0, return_inverse=True)[1].ravel()
    together = [single @ np.eye(groups.max() + 1)[groups], single @ np.eye(2)[kind]]
    return np.concatenate([single, *together], axis=-1)


def remainder(system: Equilibrium, basis: Basis, c: Array, twin: Array) -> Array:
    """Sources (t, 2 v, s), N, of what is left once the residual of a twin (t, 2 v), N, is subtracted."""
    return REMAINDER * np.concatenate([sources(system, basis, c), twin[..., None]], axis=-1)


def edge_middles(system: Equilibrium) -> Array:
    """(e, 2) mm, in the order of `edge_operators`."""
    points, triangles = system.experiment.points, system.experiment.triangles
    return points[unique_edges(triangles)[0]].mean(axis=1)
