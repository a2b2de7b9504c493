r"""Reaction forces of a test from its measured displacements, for many networks at once.

In: the equations of a test and a basis. Out: a matrix that gives the force along the pull, averaged over the grips, of every increment for
spline coefficients of a law; and r2_F = 1 - sum (F - F_measured)^2 / sum (F_measured - mean)^2 over the increments, of the paper.

The displacements are data, so that the force is linear in the energy derivatives: a network is sampled at the sites of a fine basis that
covers every test, and costs nothing more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrate.equations.basis import SingleBasis, TensorBasis
from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.inputs import INPUT_SETS, hencky_to_lode, polyconvex
from studies.accuracy.metrics import r2

Array = NDArray[np.float64]
FINE = 64  # functions of a single input
FINE_NORM, FINE_ANGLE = 28, 11


@dataclass(frozen=True)
class PredictedTest:
    """matrix (n_increments, n_functions): force along the pull, N, of coefficients; measured (n_increments,), N."""

    matrix: Array
    measured: Array

    def score(self, c: Array) -> float:
        """r2_F of coefficients c (n_functions,)."""
        return r2(self.measured, self.matrix @ c)


def fine_basis(inputs: str, systems: list[Equilibrium]) -> SingleBasis | TensorBasis:
    """A basis that covers every test, with more functions than a fit needs."""
    gradients = np.concatenate([system.deformation_gradients.reshape(-1, 2, 2) for system in systems])
    if inputs == "I1I2":
        return TensorBasis(1.02 * float(hencky_to_lode(gradients)[0].max()), FINE_NORM, FINE_ANGLE)
    k = INPUT_SETS[inputs][0]
    return SingleBasis(k, 1.05 * float(polyconvex(gradients)[0][:, k].max()), FINE)


def predicted_test(system: Equilibrium, basis: SingleBasis | TensorBasis) -> PredictedTest:
    """Of the grips whose force along their outward direction was measured; mean over them."""
    experiment, fields = system.experiment, system.fields
    middle, columns, rows = experiment.points.mean(axis=0), [], []
    for column in np.flatnonzero(fields.boundary >= 0):
        grip = experiment.loaded[fields.boundary[column]]
        outward = experiment.points[grip.nodes].mean(axis=0) - middle
        axis = int(np.argmax(np.abs(outward)))
        if np.isfinite(grip.force[:, axis]).all():
            columns.append(column)
            rows.append(np.sign(outward[axis]) * np.eye(2)[axis])
    weights = np.array(rows) / len(columns)
    slopes = system.virtual_gradients[columns].toarray().reshape(len(columns), -1, 2)
    virtual = np.einsum("bi,bmj->mij", weights, slopes)  # of the mean force along the pull
    used = np.flatnonzero(np.abs(virtual).max(axis=(1, 2)) > 0)
    matrix = np.array([_row(basis, F[used], virtual[used]) for F in system.deformation_gradients])
    forces = np.array([experiment.loaded[fields.boundary[column]].force for column in columns])
    return PredictedTest(matrix, np.einsum("bi,bti->t", weights, np.where(weights[:, None] == 0, 0.0, forces)))


def _row(basis: SingleBasis | TensorBasis, F: Array, virtual: Array) -> Array:
    """(n_functions,) N per MPa: virtual work of each function."""
    P, columns = basis.local(F)
    work = np.einsum("mqij,mij->mq", P, virtual)
    return np.bincount(columns.ravel(), work.ravel(), basis.n_functions)
