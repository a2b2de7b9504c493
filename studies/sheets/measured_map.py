"""Where a measured sheet is stiffer or softer than the model that was transferred to it.

In: an Experiment and a model. Out: `MapResult`, the stiffness factor of each place and errors before and after.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import nnls

from calibrate.data.experiment import Experiment
from calibrate.effects.chain import Chain
from calibrate.equations.equilibrium import Equilibrium, equilibrium
from calibrate.equations.virtual_fields import bilinear_hats
from calibrate.models.extended_model import ExtendedModel
from studies.sheets.measured_results import Change, ErrorChange, ErrorChangeOfParts, MapResult
from studies.sheets.model_errors import Split, force, force_and_field

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SMOOTHING = (1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 1.0)  # weights of the differences of neighbours in a map
FOLDS = 5  # of the virtual fields, drawn at random; each is left out once to choose the weight


def stiffness_map(
    e: Experiment, models: Sequence[ExtendedModel], until: float, spacing: float, cell: float
) -> MapResult:
    """Stiffness of each place over that of the transferred model, or the mean of several: bilinear on a grid of `cell` mm,
    smooth, above zero.

    The factors k of nodes minimise |sum_q k_q w_q - F|^2 / |F|^2 + weight |gradient k|^2, w_q the virtual work of the
    model's stress times the hat of node q. The weight is the one that predicts best the virtual fields left out. until:
    s; spacing: of the virtual fields, mm.
    """
    split = Split.of(e, until)
    system = equilibrium(e, spacing)
    stress_work, loads, hats = _work_by_place(e, system, models, cell)
    rows = split.fitted
    scale = np.abs(force(e))[:, None]
    A, b = stress_work / scale[..., None], loads / scale

    def flat(array: Array, keep: Mask) -> Array:
        return array[rows][:, keep].reshape(-1, *array.shape[2:])

    D = _differences(hats)
    n = A.shape[1] // 2
    fold = np.tile(np.random.default_rng(0).integers(FOLDS, size=n), 2)
    inner, known = np.tile(system.fields.boundary < 0, 2), np.isfinite(system.loads).all(axis=0)
    parts = [inner & (fold == i) for i in range(FOLDS)]

    def left_out(weight: float | None) -> float:
        """|residual| of every field by a map that does not know it; None: by the same stiffness everywhere."""
        total = 0.0
        for part in parts:
            k = (
                np.ones(A.shape[2])
                if weight is None
                else _smooth_fit(flat(A, known & ~part), flat(b, known & ~part), weight * D)
            )
            total += float(((flat(A, part) @ k - flat(b, part)) ** 2).sum())
        return float(np.sqrt(total))

    scores = [left_out(weight) for weight in SMOOTHING]
    weight = SMOOTHING[int(np.argmin(scores))]
    k = _smooth_fit(flat(A, known), flat(b, known), weight * D)
    after = np.einsum("trk,k->tr", stress_work, k) - loads
    before = stress_work.sum(axis=2) - loads
    changes = {
        part: ErrorChange(force_and_field(system, before, mask), force_and_field(system, after, mask))
        for part, mask in split.parts().items()
    }
    return MapResult(
        name=e.name,
        cell=cell,
        spacing=spacing,
        weight=weight,
        map=(hats @ k).tolist(),
        points=e.points.tolist(),
        triangles=e.triangles.tolist(),
        left_out=Change(left_out(None), min(scores)),
        errors=ErrorChangeOfParts(**changes),
    )


def _work_by_place(
    e: Experiment, system: Equilibrium, models: Sequence[ExtendedModel], cell: float
) -> tuple[Array, Array, sp.csr_array]:
    """Work (t, 2 v, q) of the models' mean stress by hats on a grid, loads (t, 2 v), hats (n, q)."""
    hats = bilinear_hats(e.points, cell)
    share = (_centroid_mean(e) @ hats).toarray()
    chains = [Chain(system, model.basis) for model in models]
    P = np.mean([chain.stress(one.c, one.additions) for chain, one in zip(chains, models, strict=True)], axis=0)
    loads = np.mean([chain.external(one.additions) for chain, one in zip(chains, models, strict=True)], axis=0)
    work = np.stack([chains[0].work(P * place[:, None, None]) for place in share.T], axis=-1)
    return work, np.nan_to_num(loads), hats


def _smooth_fit(A: Array, b: Array, D: Array) -> Array:
    """k >= 0 that minimises |A k - b|^2 + |D k|^2 (rows of D: differences of neighbours)."""
    n = A.shape[1]
    return nnls(np.concatenate([A, D]), np.concatenate([b, np.zeros(len(D))]), maxiter=50 * n)[0]


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
