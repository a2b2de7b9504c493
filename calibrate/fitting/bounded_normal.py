r"""Normal distribution with some components held non-negative, approximated by a normal one.

In: the density exp(-|J (x - x0)|^2 / 2 - prior |x - x0|^2 / 2 - gradient . (x - x0)) on x_i >= 0 for the bounded i.
Out: a factor L (n, n) of the covariance L L^T.

Expectation propagation (Minka 2001; for truncated normals Cunningham, Hennig and Lacoste-Julien 2011, arXiv:1111.6832):
each bound becomes a normal factor with precision t_i, chosen so that mean and variance along x_i are those of the
distribution cut off at 0. One bound alone is met exactly. A component far inside keeps its variance; one that presses
against its bound loses it gradually, instead of at once as when active bounds are held and the others ignored.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

Array = NDArray[np.float64]
SWEEPS, DAMPING, TOLERANCE = 50, 0.7, 1e-3


def bounded_factor(J: Array, prior: float, gradient: Array, start: Array, bounded: NDArray[np.bool_]) -> Array:
    """L (n, n); J (rows, n), gradient and start x0 (n,), bounded (n,): those with x_i >= 0."""
    shift = J.T @ (J @ start) + prior * start - gradient  # precision times mean, without bounds
    precision, pull = np.zeros_like(start), np.zeros_like(start)  # of the factors that stand for the bounds
    for _ in range(SWEEPS):
        factor = _factor(J, prior + precision)
        variance = (factor**2).sum(axis=1)
        mean = factor @ (factor.T @ (shift + pull))
        rest = 1 / np.maximum(1 / variance - precision, 1e-12 / variance)  # variance without the factor itself
        centre = rest * (mean / variance - pull)
        cut_mean, cut_variance = cut_off(centre, rest)
        target = np.where(bounded, np.maximum(1 / cut_variance - 1 / rest, 0.0), 0.0)
        change = np.abs(target - precision).max(initial=0.0, where=bounded) / (target + precision + prior).max()
        precision = precision + DAMPING * (target - precision)
        pull = pull + DAMPING * (np.where(bounded, cut_mean / cut_variance - centre / rest, 0.0) - pull)
        if change < TOLERANCE:
            break
    return _factor(J, prior + precision)


def cut_off(mean: Array, variance: Array) -> tuple[Array, Array]:
    """Mean (n,) and variance (n,) of normal distributions of `mean` and `variance` (n,), cut off below 0."""
    std = np.sqrt(variance)
    z = mean / std
    # phi / Phi; far outside it is -z + 1 / -z, and the variance 1 / z^2
    ratio = np.exp(-0.5 * z**2 - 0.5 * np.log(2 * np.pi) - log_ndtr(z))
    far = z < -30
    safe = np.where(far, z, -30.0)
    first = np.where(far, -1 / safe, z + ratio)
    second = np.where(far, 1 / safe**2, 1 - ratio * (ratio + z))
    return std * first, variance * np.maximum(second, 1e-12)


def _factor(J: Array, precision: Array | float) -> Array:
    """L with L L^T = (J^T J + diag(precision))^-1, by a singular value decomposition."""
    scale = 1 / np.sqrt(np.broadcast_to(precision, J.shape[1]))
    _, s, rows = np.linalg.svd(J * scale, full_matrices=True)
    information = np.zeros(J.shape[1])
    information[: len(s)] = s**2
    return scale[:, None] * rows.T / np.sqrt(information + 1)
