"""Small least-squares problems: orthonormal columns, what no column changes, and fits in bounds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

Array = NDArray[np.float64]
CONDITION = 1e-8
LEAST = 0.2  # of the information on an amplitude, that noise in its signature leaves
UNSEEN = 1e-4  # size of a column, relative to the largest, that is not fitted


def orthonormal(columns: Array) -> Array:
    """Orthonormal basis (N, r) of the span of columns (N, k), directions without information dropped; none (N, 0) of columns that are all zero."""
    size = np.linalg.norm(columns, axis=0)
    if not size.any():
        return columns[:, :0]
    columns = columns[:, size > 1e-9 * size.max()] / size[size > 1e-9 * size.max()]
    U, R = np.linalg.qr(columns)
    left, s, _ = np.linalg.svd(R)
    return U @ left[:, s > 1e-5 * s[0]]


def residual_outside(r: Array, columns: Array) -> tuple[float, int]:
    """|r|^2 of the part of r (N,) that no combination of columns (N, k) changes, and its degrees of freedom."""
    Q = orthonormal(columns) if columns.size else columns
    free = r - Q @ (Q.T @ r)
    return float(free @ free), len(r) - Q.shape[1]


def bounded(A: Array, target: Array, lower: Array, upper: Array, prior: Array | None = None) -> Array:
    """argmin (n,) of |A x - target|^2 + |prior x|^2 in bounds; columns scaled, reduced to their own number of rows.

    A (N, n), target (N,), lower and upper (n,), prior (r, n).
    """
    if prior is not None:
        A, target = np.concatenate([A, prior]), np.concatenate([target, np.zeros(len(prior))])
    scale = np.linalg.norm(A, axis=0)
    seen = scale > UNSEEN * scale.max()  # what the data hardly see stays at its bound, or at zero
    if not seen.all():
        result = np.clip(np.zeros(len(scale)), lower, upper)
        result[seen] = bounded(A[:, seen], target, lower[seen], upper[seen])
        return result
    Q, R = np.linalg.qr(A / scale)
    ridge = 1e-9 * np.linalg.norm(R) * np.eye(R.shape[1])
    found = lsq_linear(
        np.concatenate([R, ridge]),
        np.concatenate([Q.T @ target, np.zeros(R.shape[1])]),
        (lower * scale, upper * scale),
        method="bvls",
        max_iter=400,
    )
    return np.clip(found.x / scale, lower, upper)


def independent_errors(columns: Array, hidden: Array, noise: float, wrong: Sequence[Array]) -> Array:
    """Errors (m, p) of parameters with columns (N, p), one standard deviation in each row, which add in their squares: of noise of this standard deviation in every equation,
    and of what is wrong (N,), each. hidden (p, p): what noise adds to the squares of the columns."""
    values, vectors = np.linalg.eigh(subtract(columns.T @ columns, hidden))
    inverse = (vectors / np.maximum(values, CONDITION * values.max())) @ vectors.T
    free = np.full(columns.shape[1], np.inf)
    shifts = [bounded(columns, one, -free, free) for one in wrong]
    return np.concatenate([noise * columns @ inverse, *(one[None] for one in shifts)])


def subtract(M: Array, N: Array) -> Array:
    """M - N of symmetric M and N (p, p), no direction of M being left less than `LEAST` of itself."""
    values, vectors = np.linalg.eigh(M)
    keep = values > CONDITION * values.max()
    root = vectors[:, keep] * np.sqrt(values[keep])
    inverse = vectors[:, keep] / np.sqrt(values[keep])
    shares, turn = np.linalg.eigh(inverse.T @ N @ inverse)
    left = root @ turn
    return M - (left * np.minimum(shares, 1 - LEAST)) @ left.T
