"""Uniform clamped cubic B-splines, by the polynomials between their knots."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

Array = NDArray[np.float64]
DEGREE = 3


@dataclass(frozen=True)
class Spline:
    """Uniform clamped cubic B-splines on [low, high] with n functions; arguments outside are clipped."""

    n: int
    low: float = 0.0
    high: float = 1.0

    @cached_property
    def knots(self) -> Array:
        """Clamped knots (n + 4,)."""
        inner = np.linspace(self.low, self.high, self.n - DEGREE + 1)
        return np.concatenate([[self.low] * DEGREE, inner, [self.high] * DEGREE])

    @cached_property
    def sites(self) -> Array:
        """Greville abscissae (n,), where interpolation is well posed."""
        return np.array([self.knots[i + 1 : i + DEGREE + 1].mean() for i in range(self.n)])

    def local(self, x: Array, derivative: int = 0) -> tuple[Array, NDArray[np.int64]]:
        """The 4 non-zero functions at x (m,): values (m, 4) and the index (m,) of the first of them."""
        x = np.clip(x, self.low, self.high)
        width = (self.high - self.low) / (self.n - DEGREE)
        first = np.clip(((x - self.low) / width).astype(np.int64), 0, self.n - DEGREE - 1)
        matrix = polynomial_pieces(self.n)[derivative]
        t = (x - self.low) / width - first
        powers = np.stack([np.ones_like(t), t, t * t, t * t * t], axis=1)
        values = np.einsum("mp,mpk->mk", powers, matrix[first])
        return values / width**derivative, first

    def matrix(self, x: Array, derivative: int = 0) -> Array:
        """Dense values (m, n) at x (m,)."""
        values, first = self.local(x, derivative)
        dense = np.zeros((x.size, self.n))
        np.put_along_axis(dense, first[:, None] + np.arange(DEGREE + 1), values, axis=1)
        return dense


def pieces_of(c: Array) -> Array:
    """(n - 3, 4): powers of t, from 0 to 1 in each interval, of the spline with coefficients c (n,)."""
    local = np.stack([c[i : i + DEGREE + 1] for i in range(len(c) - DEGREE)])
    return np.einsum("ipk,ik->ip", polynomial_pieces(len(c))[0], local)


@cache
def polynomial_pieces(n: int) -> tuple[Array, Array, Array]:
    """Polynomial coefficients (interval, power, function) of n unit-width clamped B-splines and two derivatives."""
    intervals = n - DEGREE
    knots = np.concatenate([[0.0] * DEGREE, np.arange(intervals + 1.0), [float(intervals)] * DEGREE])
    t = np.array([0.05, 0.35, 0.65, 0.95])
    vandermonde = np.linalg.inv(np.vander(t, increasing=True))
    pieces = np.zeros((intervals, 4, 4))
    for i in range(intervals):
        dense = BSpline.design_matrix(i + t, knots, DEGREE).toarray()[:, i : i + DEGREE + 1]
        pieces[i] = vandermonde @ dense
    first, second = np.zeros_like(pieces), np.zeros_like(pieces)
    first[:, :3] = pieces[:, 1:] * np.array([1.0, 2.0, 3.0])[:, None]
    second[:, :2] = first[:, 1:3] * np.array([1.0, 2.0])[:, None]
    return pieces, first, second
