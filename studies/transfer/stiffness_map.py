"""Where a specimen is stiffer or softer than a model: a smooth factor on the stress of each place, and whether the test asks for it.

In: a model on a test, increments that are fitted. Out: `StiffnessMap`.

The factors k of a grid minimise |sum_q k_q w_q - F|^2 / |F|^2 + weight |gradient k|^2, w_q the virtual work of the model's stress times the hat of node
q. The weight is the one that predicts best virtual fields that were left out (cross-validation; Stone 1974). Where the model is right everywhere, the map is
as likely to predict a part of the fields better as worse. So it counts where it predicts every one of the `FOLDS` parts better.
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
FOLDS = 5  # of the virtual fields, drawn at random
CELL, MOST = 0.7, 20  # of the grid, over the spacing of the virtual fields; cells along the longest side
SMALL = 0.1  # of the largest force, below which an increment does not count more


@dataclass(frozen=True, eq=False)
class StiffnessMap:
    """values (n,): stiffness over that of the model at the points. weight: of its smoothness; without, with_it (`FOLDS`,): norm of the residual of
    fields that the map does not know, over the forces. residual (t, 2 v), N: with the map."""

    values: Array
    weight: float
    without: Array
    with_it: Array
    residual: Array

    @property
    def is_real(self) -> bool:
        """Whether it predicts every part of the fields better than the same stiffness everywhere."""
        return bool((self.with_it < self.without).all())

    @property
    def unseen(self) -> tuple[float, float]:
        """Norms over all parts, without and with the map."""
        return float(np.linalg.norm(self.without)), float(np.linalg.norm(self.with_it))


def stiffness_map(applied: Applied, fitted: Mask) -> StiffnessMap:
    """The map of a test from its increments (t,) that are fitted."""
    system = applied.chain.system
    longest = float(np.ptp(system.experiment.points, axis=0).max())
    work, loads, hats = _work_by_place(applied, max(CELL * system.fields.spacing, longest / MOST))
    size = np.linalg.norm(loads[:, np.tile(system.fields.boundary >= 0, 2)], axis=1)
    scale = np.maximum(size, SMALL * size.max())[:, None]
    A, b = work / scale[..., None], loads / scale
    known = np.isfinite(system.loads).all(axis=0)
    inner = np.tile(system.fields.boundary < 0, 2) & known
    fold = np.tile(np.random.default_rng(0).integers(FOLDS, size=A.shape[1] // 2), 2)
    parts = [inner & (fold == i) for i in range(FOLDS)]
    D = _differences(hats)
    shown = [_equations(A, b, fitted, known & ~part) for part in parts]
    hidden = [_equations(A, b, fitted, part) for part in parts]
    same = np.ones(A.shape[2])
    without = np.array([_size(*one, same) for one in hidden])
    tried = [
        np.array([_size(*one, _smooth_fit(*other, weight * D)) for one, other in zip(hidden, shown, strict=True)])
        for weight in SMOOTHING
    ]
    best = int(np.argmin([np.linalg.norm(one) for one in tried]))
    k = _smooth_fit(*_equations(A, b, fitted, known), SMOOTHING[best] * D)
    residual = np.einsum("trk,k->tr", work, k) - loads
    return StiffnessMap(hats @ k, SMOOTHING[best], without, tried[best], residual)


def _work_by_place(applied: Applied, cell: float) -> tuple[Array, Array, sp.csr_array]:
    """Work (t, 2 v, q) of the model's stress by hats on a grid, loads (t, 2 v) with the mean of the noise, hats (n, q)."""
    chain, model = applied.chain, applied.model
    e = chain.system.experiment
    hats = bilinear_hats(e.points, cell)
    share = (_centroid_mean(e) @ hats).toarray()
    P = chain.stress(model.c, model.additions)
    work = np.stack([chain.work(P * place[:, None, None]) for place in share.T], axis=-1)
    return work, np.nan_to_num(chain.external(model.additions)) + applied.shift, hats


def _equations(A: Array, b: Array, increments: Mask, rows: Mask) -> tuple[Array, Array]:
    """Those of some increments (t,) and rows (2 v,), flat."""
    A, b = A[increments][:, rows], b[increments][:, rows]
    return A.reshape(-1, A.shape[-1]), b.ravel()


def _size(A: Array, b: Array, k: Array) -> float:
    return float(np.linalg.norm(A @ k - b))


def _smooth_fit(A: Array, b: Array, D: Array) -> Array:
    """k >= 0 that minimises |A k - b|^2 + |D k|^2 (rows of D: differences of neighbours), from the normal equations."""
    factor = scipy.linalg.cholesky(A.T @ A + D.T @ D)
    return nnls(factor, scipy.linalg.solve_triangular(factor, A.T @ b, trans=1), maxiter=50 * len(factor))[0]


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
