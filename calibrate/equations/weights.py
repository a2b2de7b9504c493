"""Weights of the equations: residuals of unit covariance, from noise of every increment, noise in common and a discrepancy common to all.

In: an `EquationNoise`, and sources of a discrepancy that act alike in all increments. Out: a linear map of residuals (..., t, 2 v) to rows (..., N).

Up to `DENSE` rows the covariance of all is formed where increments have noise in common, or the discrepancy has many sources: `Whole`. Else, `Split`:

1. The part of the noise of its own: of each increment i, given those before it, L_i^-1 (r_i - M_i r_before), with L_i L_i^T the covariance that is left
   (Vecchia 1988; Katzfuss and Guinness 2021). As many are before it as tell what all before would (`memory`): none where the noise is new in each, one
   where it drifts as exp(-t / tau), those with the pictures that it is made of for an increment between pictures.
2. Sources V of the rest after 1: the covariance is I + V V^T. With V V^T = U diag(s) U^T, I - U diag(1 - 1 / sqrt(1 + s)) U^T is its inverse root.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from calibrate.equations.noise_covariance import RAN_AWAY, EquationNoise, cholesky_factor
from calibrate.errors import FitError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
DENSE = 5000  # rows up to which their covariance is formed
FELT = 1e-3  # of the variance of the noise: what sources add in a direction, from which it counts
TOLD = 1e-3  # of the variance of an increment: what those further back may tell of it beside those before it


@dataclass(frozen=True, eq=False)
class Sources:
    """Of a discrepancy common to all increments, N: what each changes in the residuals (t, 2 v).

    parts: columns (k, 2 v, s) of k increments, and the shares (t, k) of these in every one, so that many increments take no more memory than few.
    """

    parts: tuple[tuple[Array, Array], ...]

    @classmethod
    def of(cls, values: Array) -> Sources:
        """Values (t, 2 v, s) that have nothing to do with each other."""
        return cls(((values, np.eye(len(values))),))

    def __len__(self) -> int:
        return sum(columns.shape[2] for columns, _ in self.parts)

    def beside(self, other: Sources) -> Sources:
        """Both."""
        return Sources((*self.parts, *other.parts))

    def scaled(self, factor: float) -> Sources:
        """Each by a factor."""
        return Sources(tuple((factor * columns, shares) for columns, shares in self.parts))

    def increment(self, i: int) -> Array:
        """(2 v, s)."""
        return np.hstack([_mixed(columns, shares[i]) for columns, shares in self.parts])

    def rows(self, used: Mask) -> Array:
        """(N, s) of the rows (t, 2 v) used."""
        some = np.flatnonzero(used.any(axis=1)).tolist()
        return np.concatenate([np.zeros((0, len(self))), *(self.increment(i)[used[i]] for i in some)])

    @property
    def variances(self) -> Array:
        """(t, 2 v), N^2."""
        return np.array([(self.increment(i) ** 2).sum(axis=1) for i in range(len(self.parts[0][1]))])


def _mixed(columns: Array, shares: Array) -> Array:
    """Of an increment, from the few that have a share (k,) in it."""
    few = np.flatnonzero(shares)
    return np.tensordot(shares[few], columns[few], 1)


class Block(NamedTuple):
    """The rows used of an increment: root (r, r), the inverse of their Cholesky factor given the b rows before them, by gain (r, b). It is used so often that
    the inverse pays."""

    root: Array
    gain: Array


class Whole(NamedTuple):
    """lower (N, N): Cholesky factor of the covariance of all rows."""

    lower: Array

    def white(self, columns: Array) -> Array:
        """Columns (N, k) of unit covariance."""
        return _solved(self.lower, columns)

    def adjoint(self, rows: Array) -> Array:
        """The transposed map (N,)."""
        return _solved(self.lower.T, rows, lower=False)

    @property
    def log_determinant(self) -> float:
        """Of the lower factor."""
        return float(np.log(np.diag(self.lower)).sum())


class Common(NamedTuple):
    """U (N, k): orthonormal directions of the sources; taken (k,): the share of a residual along each that is taken off, see the head of this module.
    log_determinant: of the root of the covariance."""

    U: Array
    taken: Array
    log_determinant: float

    @classmethod
    def of(cls, V: Array) -> Common:
        """Of sources (N, s). Directions of less than `FELT` of the variance of the noise are left out. Raises `FitError` where they are not finite."""
        squares = V.T @ V
        if not np.isfinite(squares).all():
            raise FitError(RAN_AWAY)
        least = max(FELT, 1e-10 * float(np.trace(squares)))
        values, vectors = scipy.linalg.eigh(squares, subset_by_value=(least, np.inf))
        taken = 1 - 1 / np.sqrt(1 + values)
        return cls(V @ (vectors / np.sqrt(values)), taken, float(np.log1p(values).sum()) / 2)

    def white(self, columns: Array) -> Array:
        """Columns (N, k) without the covariance of the sources; the map is its own transpose."""
        return np.asarray(columns - self.U @ ((self.taken * (self.U.T @ columns).T).T))


class Split(NamedTuple):
    """blocks: of each increment. common: None where nothing is in common."""

    blocks: tuple[Block, ...]
    common: Common | None

    def white(self, columns: Array) -> Array:
        """Columns (N, k) of unit covariance."""
        found = _own_white(self.blocks, columns)
        return found if self.common is None else self.common.white(found)

    def adjoint(self, rows: Array) -> Array:
        """The transposed map (N,)."""
        white = rows if self.common is None else self.common.white(rows)
        flat = np.zeros(len(white))
        for before, own, block in _places(self.blocks):
            part = block.root.T @ white[own]
            flat[own] += part
            flat[before] -= block.gain.T @ part
        return flat

    @property
    def log_determinant(self) -> float:
        """Of the inverse of the map."""
        own = -sum(float(np.log(np.diag(block.root)).sum()) for block in self.blocks)
        return own + (self.common.log_determinant if self.common else 0.0)


@dataclass(frozen=True, eq=False)
class Weights:
    """rows (t, 2 v): which equations are used. variance (t, 2 v), N^2: of the noise of each; 0 of those not used. root: of the covariance. sources:
    of the discrepancy; None without."""

    rows: Mask
    variance: Array = field(repr=False)
    root: Whole | Split = field(repr=False)
    sources: Sources | None = field(repr=False)

    @property
    def size(self) -> int:
        """Number N of the equations used."""
        return int(self.rows.sum())

    def __call__(self, residuals: Array) -> Array:
        """Rows (..., N) of residuals (..., t, 2 v)."""
        flat = residuals.reshape(*residuals.shape[:-2], -1)[..., self.rows.ravel()]
        columns = flat.reshape(int(np.prod(flat.shape[:-1])), self.size).T
        return self.root.white(columns).T.reshape(flat.shape)

    @property
    def log_determinant(self) -> float:
        """Of the covariance of the residuals used."""
        return 2 * self.root.log_determinant

    def adjoint(self, white: Array) -> Array:
        """The transposed map: rows (N,) to (t, 2 v)."""
        result = np.zeros(self.rows.shape)
        result[self.rows] = self.root.adjoint(white)
        return result

    def uncertain_directions(self, least: float) -> Array:
        """Orthonormal directions (N, k) of rows in which the variance of the discrepancy is more than `least` times that of the noise.

        Sources V of unit noise have the squares s^2 = eig(V V^T), and s^2 / (1 + s^2) once their covariance is taken out, too.
        """
        if self.sources is None or not self.size:
            return np.zeros((self.size, 0))
        V = self.root.white(self.sources.rows(self.rows))
        wide = V.shape[1] > len(V)
        values, U = scipy.linalg.eigh(V @ V.T if wide else V.T @ V, subset_by_value=(least / (1 + least), np.inf))
        return U if wide else np.asarray(V @ U / np.sqrt(values))


def weights_of(noise: EquationNoise, rows: Mask, sources: Sources | None = None) -> Weights:
    """Weights for the equations `rows` (t, 2 v) with a noise and the sources of a discrepancy common to all."""
    return Weights(rows, noise.variance(rows), _root(noise, rows, sources), sources)


def _root(noise: EquationNoise, rows: Mask, sources: Sources | None) -> Whole | Split:
    """Of the covariance of the rows used."""
    n = int(rows.sum())
    if not n:
        return Split((), None)
    more = np.zeros((n, 0)) if sources is None else sources.rows(rows)
    if n <= DENSE and (2 * more.shape[1] > n or not noise.is_new_in_each):
        return Whole(cholesky_factor(noise.covariance(rows) + more @ more.T))
    blocks = tuple(_blocks(noise, rows))
    every = more if noise.is_new_in_each else np.concatenate([noise.sources[rows], more], axis=1)
    if not every.size:
        return Split(blocks, None)
    V = _own_white(blocks, every)
    return Split(blocks, Common.of(V if V.shape[1] <= len(V) else cholesky_factor(V @ V.T)))


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
