"""Smoothing of nodal fields over a length: B - length^2 laplace B = raw, linear on the triangles.

No flux through free edges; B = 0 at grips. The equations are solved by conjugate gradients, differentiable by raw.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.effects.support.nodal_derivatives import stencil_matrix, stencil_sum
from calibrate.equations import kinematics

Array = NDArray[np.float64]
RIGID = 0.05  # largest deviation of a grip from a translation, over the largest displacement in the specimen
PADDING = 4  # rows are padded to a multiple of it, so that meshes of one size share compiled code
TOLERANCE = 1e-7  # of the solution, relative
ITERATIONS = 300


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Membrane:
    """nodes (n, k): neighbours of each node; stiffness (n, k): int grad N . grad N dA; mass (n,): area of each node, mm^2;
    held (n,): 1 at the nodes of grips, else 0."""

    nodes: Any
    stiffness: Any
    mass: Any
    held: Any

    @classmethod
    def of(cls, experiment: Experiment) -> Membrane:
        """Prepare an Experiment."""
        points, triangles = experiment.points, experiment.triangles
        areas = kinematics.shape_gradients(points, triangles)[1]
        linear = kinematics.gradient_operator(points, triangles)
        stiffness = sp.csr_array(linear.T @ sp.diags_array(np.repeat(areas, 2)) @ linear)
        counts = np.diff(stiffness.indptr)
        width = PADDING * int(np.ceil(counts.max() / PADDING))
        place = np.arange(width) < counts[:, None]
        nodes, values = np.zeros((len(points), width), np.int64), np.zeros((len(points), width))
        nodes[place], values[place] = stiffness.indices, stiffness.data
        mass = np.bincount(triangles.ravel(), np.repeat(areas / 3, 3), len(points))
        return cls(*(jnp.asarray(a) for a in (nodes, values, mass, held_nodes(experiment))))

    def smoothed(self, raw: Any, length: Any) -> Any:
        """B (t, n, 2) of raw (t, n, 2); length in mm."""
        free = (1.0 - self.held)[:, None]
        columns = jnp.moveaxis(raw, 1, 0).reshape(len(self.mass), -1)
        mass = jnp.where(self.mass > 0, self.mass, 1.0)[:, None]
        own = (self.nodes == jnp.arange(len(self.mass))[:, None]) * self.stiffness
        diagonal = mass + length**2 * own.sum(axis=1)[:, None]

        def operator(b):
            inner = stencil_sum(self.nodes, self.stiffness[:, :, None], (free * b)[None])[0, :, :, 0]
            return free * (mass * b + length**2 * inner) + (1.0 - free) * diagonal * b

        found = jax.scipy.sparse.linalg.cg(
            operator, free * mass * columns, tol=TOLERANCE, maxiter=ITERATIONS, M=lambda r: r / diagonal
        )[0]
        return jnp.moveaxis(found.reshape(len(self.mass), raw.shape[0], 2), 0, 1)

    def adjoint(self, length: float) -> Callable[[Array], Array]:
        """The transpose of `smoothed` as a map of columns (n, k); its matrix, which is symmetric, is factorised once. length in mm."""
        mass, free = np.asarray(self.mass), 1.0 - np.asarray(self.held)
        mass, only_free = np.where(mass > 0, mass, 1.0), sp.diags_array(free)
        stiffness = only_free @ stencil_matrix(self.nodes, self.stiffness) @ only_free
        factor = scipy.sparse.linalg.splu(
            sp.csc_array(sp.diags_array(mass) + length**2 * stiffness), permc_spec="MMD_AT_PLUS_A"
        )
        return lambda columns: (free * mass)[:, None] * factor.solve(columns)


def held_nodes(experiment: Experiment) -> Array:
    """(n,): 1 at the nodes of loaded boundaries that are translated as a whole, as grips are, else 0."""
    found = np.zeros(len(experiment.points))
    u = experiment.displacements
    largest = np.linalg.norm(u - u.mean(axis=1, keepdims=True), axis=2).max()
    for boundary in experiment.loaded:
        edge = u[:, boundary.nodes]
        if np.linalg.norm(edge - edge.mean(axis=1, keepdims=True), axis=2).max() <= RIGID * largest:
            found[boundary.nodes] = 1.0
    return found
