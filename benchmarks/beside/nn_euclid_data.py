"""What NN-EUCLID judges a law by: its loss on a test, and its six deformation paths.

In: an Experiment that was imported from its folders, and first Piola-Kirchhoff stresses. Out: the loss (N^2), the paths.
After the formulas of Thakolkaran et al. 2022, J. Mech. Phys. Solids 169, 105076 (Eqs. 12 to 15 and section 4.2):

    loss = sum over load steps [sum over free degrees of freedom f^2 + sum over sides (sum over its nodes f - R)^2],

with nodal forces f of linear triangles in plane strain and R the reaction of a side.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.data.triangulation import signed_areas
from calibrate.equations.kinematics import deformation_gradients, gradient_operator

Array = NDArray[np.float64]
PATHS = ("UT", "UC", "PS", "BC", "BT", "SS")
TITLES = {
    "UT": "uniaxial tension",
    "UC": "uniaxial compression",
    "PS": "pure shear",
    "BC": "biaxial compression",
    "BT": "biaxial tension",
    "SS": "simple shear",
}
GAMMA = np.linspace(0.0, 1.0, 201)
SEEN = 0.3  # of gamma, about the largest stretch less one that the sides are pulled to


def path_gradients(path: str) -> Array:
    """F (201, 2, 2) of a path at `GAMMA`."""
    one, longer, shorter = np.ones_like(GAMMA), 1 + GAMMA, 1 / (1 + GAMMA)
    diagonal = {
        "UT": (longer, one),
        "UC": (shorter, one),
        "PS": (longer, shorter),
        "BC": (shorter, shorter),
        "BT": (longer, longer),
        "SS": (one, one),
    }
    F = np.zeros((len(GAMMA), 2, 2))
    F[:, 0, 0], F[:, 1, 1] = diagonal[path]
    if path == "SS":
        F[:, 0, 1] = GAMMA
    return F


def path_energy(F: Array, P: Array) -> Array:
    """Energy (k,) along a path that starts undeformed, by the trapezoidal rule over P : dF; F, P (k, 2, 2)."""
    steps = np.einsum("kij,kij->k", 0.5 * (P[1:] + P[:-1]), np.diff(F, axis=0))
    return np.concatenate([[0.0], np.cumsum(steps)])


@dataclass(frozen=True)
class NodalLoss:
    """NN-EUCLID's loss on an Experiment in plane strain."""

    experiment: Experiment

    @cached_property
    def gradient(self) -> sp.csr_array:
        """Nodal values to gradients of linear triangles (2 m, n)."""
        return gradient_operator(self.experiment.points, self.experiment.triangles)

    @cached_property
    def gradients(self) -> Array:
        """F (t, m, 2, 2)."""
        return deformation_gradients(self.gradient, self.experiment.displacements)

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """(n, 2): degrees of freedom that no side holds."""
        free = np.ones((len(self.experiment.points), 2), bool)
        for side in self.experiment.loaded:
            free[np.ix_(side.nodes, np.flatnonzero(side.held))] = False
        return free

    def nodal_forces(self, P: Array) -> Array:
        """(t, n, 2), N, of P (t, m, 2, 2)."""
        area = np.repeat(signed_areas(self.experiment.points, self.experiment.triangles), 2)
        columns = [[self.gradient.T @ (area * p[:, i].ravel()) for i in (0, 1)] for p in P]
        return np.moveaxis(np.array(columns), 1, 2)

    def __call__(self, P: Array) -> tuple[float, float]:
        """Parts of the loss: free degrees of freedom, sides."""
        forces = self.nodal_forces(P)
        sides = 0.0
        for side in self.experiment.loaded:
            for k in np.flatnonzero(side.held):
                sides += float(((forces[:, side.nodes, k].sum(axis=1) - side.force[:, k]) ** 2).sum())
        return float((forces[:, self.free] ** 2).sum()), sides
