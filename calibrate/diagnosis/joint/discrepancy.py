"""A model discrepancy in the covariance: equilibrium may fail by something smooth that is in no catalogue.

In: a `Problem`. Out: the same with body forces D a of unknown size in the covariance of its whitened equations, 1 + v D D^T (Kennedy and
O'Hagan 2001), and the variance of what is not smooth in the equations without a load. Without it, thousands of equations decide against any prior, as if a catalogue of formulas were complete.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from calibrate.diagnosis import model_weights
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.residual_tests import smooth_body_forces
from calibrate.equations.weights import weights_of
from calibrate.fitting.least_squares import orthonormal, residual_outside

Array = NDArray[np.float64]
COSINES = 3  # over each side of a specimen


@dataclass(frozen=True, eq=False)
class WithDiscrepancy(Problem):
    """A problem whose training rows have the covariance 1 + variance D D^T; directions D (N, k), orthonormal."""

    directions: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    variance: float = 0.0

    def whiten(self, values: Any) -> Array:
        """As `Problem.whiten`, with the discrepancy in the covariance."""
        rows = super().whiten(values)
        along = rows @ self.directions
        return rows - (1 - 1 / np.sqrt(1 + self.variance)) * along @ self.directions.T


def directions(problem: Problem) -> Array:
    """Smooth body forces (N, k), orthonormal. They change no force of a grip, as body forces beside it would: those are measured."""
    blocks = [part.train(np.where(part.inside, smooth_body_forces(part, COSINES), 0.0)).T for part in problem.trained]
    return orthonormal(problem.padded(scipy.linalg.block_diag(*blocks)))


def with_discrepancy(problem: Problem, D: Array, variance: float) -> WithDiscrepancy:
    """The problem with the directions D (N, k) and their variance, over that of noise."""
    own = {f.name: getattr(problem, f.name) for f in fields(Problem)}
    return WithDiscrepancy(**own, directions=D, variance=variance)


def variance_of(residual: Array, D: Array) -> float:
    """Restricted maximum likelihood of the variance along D (N, k), over that of the rest, of a residual (N,) without discrepancy."""
    y = D.T @ residual
    smooth = float(y @ y)
    rest = (float(residual @ residual) - smooth) / max(len(residual) - len(y), 1)
    return max(smooth / max(len(y), 1) / max(rest, 1e-300) - 1, 0.0)


def field_variance(problem: Problem, c: Array) -> float:
    """Mean square, over that of noise, of the equations without a load of a base c (n,), at least 1, but for what is smooth over the specimen: a component of variance of its
    own (Helmert 1907; Förstner 1979), by which a model is wrong in places that the forces know nothing of."""
    left, degrees = 0.0, 0
    for part in problem.trained:
        rows = part.train.rows & part.inside
        if not rows.any():
            continue
        weights = weights_of(
            model_weights.noise_of(part.chain, part.assembled, problem.weights_c, problem.amplifying), rows, part.common
        )
        smooth = weights(smooth_body_forces(part, COSINES)).T
        rest, n = residual_outside(weights(part.residual(c)), smooth)
        left, degrees = left + rest, degrees + n
    return max(1.0, left / degrees) if degrees > 0 else 1.0
