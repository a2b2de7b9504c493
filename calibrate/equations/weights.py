"""Weights of the equations: residuals of unit covariance, from noise of every increment and a discrepancy common to all.

In: the noise covariance of each increment, or of all together where they have noise in common, and sources that act alike in all. Out: a linear
map of residuals (..., t, 2 v) to rows (..., N). With V the sources after the noise is whitened, the covariance is I + V V^T and its inverse root
I + U (1 / sqrt(1 + s^2) - 1) U^T, where V = U s W^T.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from calibrate.equations.noise_covariance import cholesky_factor

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SMALL = 0.02  # variance of a discrepancy over that of noise, below which it is left out


@dataclass(frozen=True, eq=False)
class Weights:
    """rows (t, 2 v): which equations are used. lowers: Cholesky factor of each increment's noise, or one of all. U (N, s),
    shrink (s,): see above."""

    rows: Mask
    lowers: tuple[Array, ...]
    U: Array
    shrink: Array

    @property
    def size(self) -> int:
        """Number N of the equations used."""
        return int(self.rows.sum())

    def __call__(self, residuals: Array) -> Array:
        """Rows (..., N) of residuals (..., t, 2 v)."""
        white = self._noise(residuals)
        return white + ((white @ self.U) * self.shrink) @ self.U.T

    @property
    def grouped(self) -> Mask:
        """rows (g, t 2 v / g), one row for each of lowers."""
        return self.rows.reshape(len(self.lowers), -1)

    @property
    def log_determinant(self) -> float:
        """Of the covariance of the residuals used."""
        lowers = sum(2 * float(np.log(np.diag(lower)).sum()) for lower in self.lowers)
        return lowers - 2 * float(np.log1p(self.shrink).sum())

    @property
    def variance(self) -> Array:
        """Of the noise of each equation (t, 2 v), N^2; 0 of those not used."""
        result = np.zeros(self.grouped.shape)
        for values, used, lower in zip(result, self.grouped, self.lowers, strict=True):
            values[used] = (lower**2).sum(axis=1)
        return result.reshape(self.rows.shape)

    def adjoint(self, white: Array) -> Array:
        """The transposed map: rows (N,) to (t, 2 v)."""
        white = white + self.U @ (self.shrink * (self.U.T @ white))
        result, start = np.zeros(self.grouped.shape), 0
        for values, used, lower in zip(result, self.grouped, self.lowers, strict=True):
            part = white[start : start + len(lower)]
            start += len(lower)
            if len(lower):
                values[used] = scipy.linalg.solve_triangular(lower, part, lower=True, trans="T")
        return result.reshape(self.rows.shape)

    @staticmethod
    def _solved(lower: Array, rows: Array) -> Array:
        """What is not finite stays so: a fit that runs away is for the fit to name."""
        return np.asarray(scipy.linalg.solve_triangular(lower, rows, lower=True, check_finite=False))

    def _noise(self, residuals: Array) -> Array:
        leading = residuals.shape[:-2]
        flat = residuals.reshape(-1, *self.grouped.shape)
        parts = []
        for i, (used, lower) in enumerate(zip(self.grouped, self.lowers, strict=True)):
            if len(lower):
                parts.append(self._solved(lower, flat[:, i, used].T).T)
        return np.concatenate(parts, axis=1).reshape(*leading, -1)


def weights_of(noise: list[Array], rows: Mask, sources: Array | None = None) -> Weights:
    """Weights for the equations `rows` (t, 2 v) of `noise` covariances, N^2: one (2 v, 2 v) an increment, or one of all (t 2 v, t 2 v);
    sources (t, 2 v, s) of a common discrepancy."""
    lowers = [
        cholesky_factor(covariance[np.ix_(used, used)]) if used.any() else np.zeros((0, 0))
        for covariance, used in zip(noise, rows.reshape(len(noise), -1), strict=True)
    ]
    n = int(rows.sum())
    plain = Weights(rows, tuple(lowers), np.zeros((n, 0)), np.zeros(0))
    if sources is None or n == 0:
        return plain
    V = plain(np.moveaxis(sources, -1, 0)).T
    if V.shape[1] > n:
        values, U = np.linalg.eigh(V @ V.T)
    else:
        values, W = np.linalg.eigh(V.T @ V)
        keep = values > 1e-8 * max(values.max(), 1e-300)
        values, U = values[keep], V @ W[:, keep] / np.sqrt(values[keep])
    keep = values > SMALL
    return Weights(rows, tuple(lowers), U[:, keep], 1 / np.sqrt(1 + values[keep]) - 1)
