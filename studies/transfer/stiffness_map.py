"""Where a specimen is stiffer or softer than a model: a smooth factor on the stress of each place, and whether the test asks for it.

In: a model on a test, increments that are fitted. Out: `StiffnessMap`.

The factors k of a grid minimise the sum over the increments of |sum_q k_q w_q - F|^2 / |F|^2, F the forces of the increment and w_q the virtual work of the model's
stress times the hat of node q, plus weight^2 times that of (k_q - k_r)^2 over all neighbours q, r whose hats overlap, along diagonals, too. The weight is the one that predicts best virtual fields that were left out (cross-validation; Stone 1974). The map counts where the mean squared error of
fields that it does not know is smaller than that of the same stiffness everywhere by a share `LESS`. The fields are divided into `FOLDS` parts, each of which is
predicted by the others, with a weight that these have chosen; and that `DIVISIONS` times, as one division may be lucky (repeated cross-validation; Burman 1989).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import nnls

from calibrate.data.experiment import Experiment
from calibrate.equations.virtual_fields import bilinear_hats
from calibrate.models.extended_model import Applied

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SMOOTHING = (1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 1.0)  # weights of the differences of neighbours in a map
FOLDS, DIVISIONS = 5, 10  # parts of the virtual fields, drawn at random; how often
LESS = 0.05  # of the mean squared error of fields that were left out, to be more than noise (docs/transfer.md)
CELL, MOST = 0.7, 20  # of the grid, over the spacing of the virtual fields; cells along the longest side
LEVEL = 100.0  # weight of the mean force over that of all forces
SMALL = 0.1  # of the largest force, below which an increment does not count more


@dataclass(frozen=True, eq=False)
class StiffnessMap:
    """values (n,): stiffness over that of the model at the points. weight: of its smoothness; without, with_it: norm of the residual of
    fields that the map does not know, over the forces, root mean square over the divisions. residual (t, 2 v), N: with the map."""

    values: Array
    weight: float
    without: float
    with_it: float
    residual: Array

    @property
    def is_real(self) -> bool:
        """Whether it predicts what it does not know better than the same stiffness everywhere."""
        return self.gain > LESS

    @property
    def gain(self) -> float:
        """By which share the mean squared error of what it does not know is smaller."""
        return 1.0 - (self.with_it / self.without) ** 2 if self.without > 0 else 0.0


def stiffness_map(applied: Applied, fitted: Mask) -> StiffnessMap:
    """The map of a test from its increments (t,) that are fitted."""
    system = applied.chain.system
    longest = float(np.ptp(system.experiment.points, axis=0).max())
    work, loads, hats = _work_by_place(applied, max(CELL * system.fields.spacing, longest / MOST))
    known = np.isfinite(system.loads)
    inner = np.tile(system.fields.boundary < 0, 2) & known
    scale = _sizes(work, loads, known & ~inner)[:, None]
    A, b = work / scale[..., None], loads / scale
    grips = _with_level(_normal(A, b, fitted, known & ~inner))
    D = _differences(hats)
    rng, divisions = np.random.default_rng(0), []
    for _ in range(DIVISIONS):
        fold = np.tile(rng.integers(FOLDS, size=A.shape[1] // 2), 2)
        divisions.append([_normal(A, b, fitted, inner & (fold == i)) for i in range(FOLDS)])
    predicted = [
        _predicted(one, grips, parts[:i] + parts[i + 1 :], D) for parts in divisions for i, one in enumerate(parts)
    ]
    whole = sum(divisions[0][1:], start=divisions[0][0])
    weight = _weight(grips, divisions, D)
    k = _smooth_fit(grips + whole, weight * D)
    residual = np.einsum("trk,k->tr", work, k) - loads
    with_it = float(np.linalg.norm(predicted) / np.sqrt(DIVISIONS))
    return StiffnessMap(hats @ k, weight, whole.misfit(np.ones(A.shape[2])), with_it, residual)


@dataclass(frozen=True, eq=False)
class _Normal:
    """Normal equations of A k = b: H = A^T A, g = A^T b, s = b^T b."""

    H: Array
    g: Array
    s: float

    def __add__(self, other: _Normal) -> _Normal:
        return _Normal(self.H + other.H, self.g + other.g, self.s + other.s)

    def misfit(self, k: Array) -> float:
        """|A k - b|."""
        return float(np.sqrt(max(float(k @ self.H @ k) - 2 * float(self.g @ k) + self.s, 0.0)))


def _normal(A: Array, b: Array, increments: Mask, rows: Mask) -> _Normal:
    """Of some increments (t,) and rows (t, 2 v)."""
    A, b = A[rows & increments[:, None]], b[rows & increments[:, None]]
    return _Normal(A.T @ A, A.T @ b, float(b @ b))


def _sizes(work: Array, loads: Array, grips: Mask) -> Array:
    """Norm of the forces of each increment (t,), N, at least `SMALL` of the largest. grips (t, 2 v): which are known; one that is known in other increments
    alone is taken from the model."""
    forces = np.where(grips, loads, work.sum(axis=-1)) * grips.any(axis=0)
    size = np.linalg.norm(forces, axis=1)
    return np.maximum(size, SMALL * size.max())


def _with_level(grips: _Normal) -> _Normal:
    """The equations of the forces with their level held: fields have no load, so that with them alone every stiffness would be too small."""
    target = float(np.sqrt(grips.s))
    row = grips.g / target
    return grips + _Normal(LEVEL**2 * np.outer(row, row), LEVEL**2 * target * row, (LEVEL * target) ** 2)


def _predicted(hidden: _Normal, grips: _Normal, shown: list[_Normal], D: Array) -> float:
    """Misfit of a hidden part by the map of the others, whose weight is theirs, too."""
    k = _smooth_fit(sum(shown, start=grips), _weight(grips, [shown], D) * D)
    return hidden.misfit(k)


def _weight(grips: _Normal, divisions: list[list[_Normal]], D: Array) -> float:
    """The weight with which each part of every division is predicted best by the others of it."""

    def misfit(weight: float) -> float:
        return sum(
            one.misfit(_smooth_fit(sum(parts[:i] + parts[i + 1 :], start=grips), weight * D)) ** 2
            for parts in divisions
            for i, one in enumerate(parts)
        )

    return min(SMOOTHING, key=misfit)


def _work_by_place(applied: Applied, cell: float) -> tuple[Array, Array, sp.csr_array]:
    """Work (t, 2 v, q) of the model's stress by hats on a grid, loads (t, 2 v) with the mean of the noise, hats (n, q)."""
    chain, model = applied.chain, applied.model
    e = chain.system.experiment
    hats = bilinear_hats(e.points, cell)
    share = (_centroid_mean(e) @ hats).toarray()
    P = chain.stress(model.c, model.additions)
    work = np.stack([chain.work(P * place[:, None, None]) for place in share.T], axis=-1)
    return work, np.nan_to_num(chain.external(model.additions)) + applied.shift, hats


def _smooth_fit(equations: _Normal, D: Array) -> Array:
    """k >= 0 that minimises |A k - b|^2 + |D k|^2 (rows of D: differences of neighbours)."""
    factor = scipy.linalg.cholesky(equations.H + D.T @ D)
    return nnls(factor, scipy.linalg.solve_triangular(factor, equations.g, trans=1), maxiter=50 * len(factor))[0]


def _differences(hats: sp.csr_array) -> Array:
    """(pairs, q): differences of the values of neighbouring hats (n, q), those that overlap."""
    pairs = sp.triu(hats.T @ hats, k=1).tocoo()
    D = np.zeros((pairs.nnz, hats.shape[1]))
    D[np.arange(pairs.nnz), pairs.row], D[np.arange(pairs.nnz), pairs.col] = 1.0, -1.0
    return D


def _centroid_mean(e: Experiment) -> sp.csr_array:
    m = len(e.triangles)
    rows = np.repeat(np.arange(m), 3)
    return sp.csr_array((np.full(3 * m, 1 / 3), (rows, e.triangles.ravel())), shape=(m, len(e.points)))
