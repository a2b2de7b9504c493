"""Weights of the equations: residuals of unit covariance, from noise of every increment, noise in common and a discrepancy common to all.

In: an `EquationNoise`, and sources of a discrepancy that act alike in all increments. Out: a linear map of residuals (..., t, 2 v) to rows (..., N).

1. The part of the noise of its own: of each increment i, given those before it, L_i^-1 (r_i - M_i r_before), with L_i L_i^T the covariance that is left
   (Vecchia 1988; Katzfuss and Guinness 2021). As many are before it as tell what all before would (`memory`): none where the noise is new in each, one
   where it drifts as exp(-t / tau), those with the pictures that it is made of for an increment between pictures.
2. What the noise has in common, V after 1: the covariance is I + V V^T. With C C^T = I + V^T V, I - V (I + C^T)^-1 C^-1 V^T is an inverse root. Up to `DENSE` rows
   its Cholesky factor takes less time than V does.
3. The discrepancy, V = U s W^T after 2: the inverse root of I + V V^T is I + U (1 / sqrt(1 + s^2) - 1) U^T.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from calibrate.equations.noise_covariance import EquationNoise, cholesky_factor

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SMALL = 0.02  # variance of a discrepancy over that of noise, below which it is left out
DENSE = 5000  # rows up to which the covariance of what is in common is formed
TOLD = 1e-3  # of the variance of an increment: what those further back may tell of it beside those before it


class Block(NamedTuple):
    """The rows used of an increment: root (r, r), the inverse of their Cholesky factor given the b rows before them, by gain (r, b). It is used so often that
    the inverse pays."""

    root: Array
    gain: Array


class Whole(NamedTuple):
    """lower (N, N): Cholesky factor of the covariance I + V V^T, see the head of this module."""

    lower: Array

    def white(self, rows: Array) -> Array:
        """Rows (..., N) without the covariance of what is in common."""
        return _solved(self.lower, rows.reshape(-1, len(self.lower)).T).T.reshape(rows.shape)

    def adjoint(self, rows: Array) -> Array:
        """The transposed map (N,)."""
        return _solved(self.lower.T, rows, lower=False)

    @property
    def log_determinant(self) -> float:
        """Of the lower factor."""
        return float(np.log(np.diag(self.lower)).sum())


class Common(NamedTuple):
    """V (N, s) and inner = (I + C^T)^-1 C^-1 (s, s), see the head of this module. log_determinant: of C."""

    V: Array
    inner: Array
    log_determinant: float

    @classmethod
    def of(cls, V: Array) -> Common:
        """Of sources (N, s)."""
        lower = cholesky_factor(np.eye(V.shape[1]) + V.T @ V)
        inverse = _solved(lower, np.eye(len(lower)))
        inner = _solved(np.eye(len(lower)) + lower.T, inverse, lower=False)
        return cls(V, inner, float(np.log(np.diag(lower)).sum()))

    def white(self, rows: Array) -> Array:
        """Rows (..., N) without the covariance of what is in common."""
        return np.asarray(rows - rows @ self.V @ self.inner.T @ self.V.T)

    def adjoint(self, rows: Array) -> Array:
        """The transposed map (N,)."""
        return np.asarray(rows - self.V @ (self.inner.T @ (self.V.T @ rows)))


@dataclass(frozen=True, eq=False)
class Weights:
    """rows (t, 2 v): which equations are used. variance (t, 2 v), N^2: of the noise of each; 0 of those not used. blocks: of each increment. common:
    None where the noise has nothing in common. U (N, s), shrink (s,): of the discrepancy, see the head of this module."""

    rows: Mask
    variance: Array = field(repr=False)
    blocks: tuple[Block, ...] = field(repr=False)
    common: Common | Whole | None = field(repr=False)
    U: Array = field(repr=False)
    shrink: Array = field(repr=False)

    @property
    def size(self) -> int:
        """Number N of the equations used."""
        return int(self.rows.sum())

    def __call__(self, residuals: Array) -> Array:
        """Rows (..., N) of residuals (..., t, 2 v)."""
        flat = residuals.reshape(*residuals.shape[:-2], -1)[..., self.rows.ravel()]
        white = _own_white(self.blocks, flat.reshape(-1, self.size).T).T.reshape(flat.shape)
        if self.common is not None:
            white = self.common.white(white)
        return white + ((white @ self.U) * self.shrink) @ self.U.T

    @property
    def log_determinant(self) -> float:
        """Of the covariance of the residuals used."""
        own = -sum(float(np.log(np.diag(block.root)).sum()) for block in self.blocks)
        common = self.common.log_determinant if self.common else 0.0
        return 2 * (own + common - float(np.log1p(self.shrink).sum()))

    def adjoint(self, white: Array) -> Array:
        """The transposed map: rows (N,) to (t, 2 v)."""
        white = white + self.U @ (self.shrink * (self.U.T @ white))
        if self.common is not None:
            white = self.common.adjoint(white)
        flat = np.zeros(len(white))
        for before, own, block in _places(self.blocks):
            part = block.root.T @ white[own]
            flat[own] += part
            flat[before] -= block.gain.T @ part
        result = np.zeros(self.rows.shape)
        result[self.rows] = flat
        return result


def weights_of(noise: EquationNoise, rows: Mask, sources: Array | None = None) -> Weights:
    """Weights for the equations `rows` (t, 2 v) with a noise and the sources (t, 2 v, s) of a discrepancy common to all."""
    n, blocks = int(rows.sum()), tuple(_blocks(noise, rows))
    common = _common(blocks, noise, rows) if n and not noise.is_new_in_each else None
    plain = Weights(rows, noise.variance(rows), blocks, common, np.zeros((n, 0)), np.zeros(0))
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
    return replace(plain, U=U[:, keep], shrink=1 / np.sqrt(1 + values[keep]) - 1)


def _common(blocks: tuple[Block, ...], noise: EquationNoise, rows: Mask) -> Common | Whole:
    """Of the rows used."""
    if rows.sum() <= DENSE:
        half = _own_white(blocks, noise.covariance_in_common(rows))
        return Whole(cholesky_factor(np.eye(len(half)) + _own_white(blocks, half.T)))
    V = _own_white(blocks, noise.sources[rows])
    if V.shape[1] > len(V):
        V = cholesky_factor(V @ V.T)
    return Common.of(V)


def _blocks(noise: EquationNoise, rows: Mask) -> Iterator[Block]:
    """Of every increment with rows that are used."""
    some = np.flatnonzero(rows.any(axis=1))
    for last, first in enumerate(_starts(noise.own[np.ix_(some, some)], rows[some])):
        near, r = some[first : last + 1], int(rows[some[last]].sum())
        covariance = np.block([[noise.own_covariance(i, j)[np.ix_(rows[i], rows[j])] for j in near] for i in near])
        lower, b = cholesky_factor(covariance), len(covariance) - r
        gain = scipy.linalg.solve_triangular(lower[:b, :b], lower[b:, :b].T, lower=True, trans="T").T
        yield Block(_solved(lower[b:, b:], np.eye(r)), gain)


def _starts(own: Array, rows: Mask) -> NDArray[np.int64]:
    """(t,): of each increment the first of those before it that tell of it; own (t, t) between increments, rows (t, 2 v) used of each."""
    found = np.arange(len(own))
    for used in np.unique(rows.T, axis=0):
        some = np.flatnonzero(used)
        m = memory(own[np.ix_(some, some)])
        found[some] = np.minimum(found[some], some[np.maximum(np.arange(len(some)) - m, 0)])
    return found


def memory(own: Array) -> int:
    """Smallest number of increments before one that tell of it what all before it would, to `TOLD`; own (t, t): covariance between increments."""
    if not len(own):
        return 0
    known, variance = np.diag(cholesky_factor(own)) ** 2, np.diag(own)
    return next(m for m in range(len(own)) if (_left(own, m) - known <= TOLD * variance).all())


def _left(own: Array, m: int) -> Array:
    """Variance (t,) of each increment given the m before it; own (t, t)."""
    t = len(own)
    padded = np.eye(t + m)  # the first have fewer before them: beside numbers that have nothing to do with them
    padded[m:, m:] = own + 1e-10 * np.diag(np.diag(own))
    before = np.arange(t)[:, None] + np.arange(m)
    inner, outer = padded[before[:, :, None], before[:, None, :]], padded[np.arange(m, m + t)[:, None], before]
    return np.asarray(np.diag(own) - np.einsum("tm,tm->t", outer, np.linalg.solve(inner, outer[..., None])[..., 0]))


def _places(blocks: tuple[Block, ...]) -> Iterator[tuple[slice, slice, Block]]:
    """Places in the rows used of what is before each block, and of the block."""
    start = 0
    for block in blocks:
        r, b = block.gain.shape
        yield slice(start - b, start), slice(start, start + r), block
        start += r


def _own_white(blocks: tuple[Block, ...], flat: Array) -> Array:
    """Columns (N, k) without the covariance of the part of its own."""
    found = np.empty(flat.shape)
    for before, own, block in _places(blocks):
        found[own] = block.root @ (flat[own] - block.gain @ flat[before])
    return found


def _solved(triangle: Array, columns: Array, lower: bool = True) -> Array:
    """What is not finite stays so: a fit that runs away is for the fit to name."""
    return np.asarray(scipy.linalg.solve_triangular(triangle, columns, lower=lower, check_finite=False))
