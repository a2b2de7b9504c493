"""Displacement noise as a linear map of independent normal numbers, and what it does to the equations.

In: points and a `Noise`. Out: a sparse factor B (n_nodes, n_sources) with B B^T = covariance of one component,
samples of the field, and the covariance of the residuals.

A squared-exponential field is the convolution of white noise with a Gaussian of length l / sqrt(2); sources on
a grid of 0.7 l reproduce its covariance to 3e-4, whatever the number of points.

Noise of increments i and j that is correlated (`Noise`) correlates their equations: with B that of displacement_std and M the covariance between
increments over its square, that of their residuals is M_ij K_i B B^T K_j^T. M has a part of its own, and what is common to all (`EquationNoise`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg.blas import dtrmm
from scipy.spatial import cKDTree

from calibrate.data.experiment import Experiment, Noise
from calibrate.data.measurement import one_cell
from calibrate.equations.basis import Basis, tangent_modulus
from calibrate.equations.equilibrium import Equilibrium
from calibrate.errors import FitError
from meshes.mesh import spacing_of

Array = NDArray[np.float64]
SINGULAR = 1e-10  # smallest over largest variance of a sum of increments
RAN_AWAY = "the noise of the equations cannot be computed: the stiffness of the material ran away; check forces and their signs, and the largest strains"
NEGLIGIBLE = 0.1  # variance of a source in common, over that of displacement_std, in all increments, that is left out


def default_noise(experiment: Experiment, spacing: float) -> Noise:
    """Stand-in where the noise is unknown: displacements to 1e-4 of the extent, correlated over a fifth of the spacing of the virtual fields, forces to
    1e-4. Only the relative weight of the equations follows from it."""
    extent = float(np.ptp(experiment.points, axis=0).max())
    return Noise(1e-4 * extent, spacing / 5, 1e-4)


def noise_factor(experiment: Experiment, noise: Noise) -> sp.csr_array:
    """B (n_nodes, n_sources), mm, of the points of a test (`factor_of_points`); where points are continued, of those that they are continued from."""
    factor = factor_of_points(experiment.points[: experiment.n_measured], noise)
    return factor if experiment.continued is None else sp.csr_array(sp.vstack([factor, experiment.continued @ factor]))


def factor_of_points(points: Array, noise: Noise) -> sp.csr_array:
    """B (n, n_sources), mm, with B B^T = std^2 C(r), see `Noise`; of a length below the distance of the points: std times identity."""
    parts = [_factor(points, noise.displacement_std * share**0.5, length) for length, share in noise.lengths]
    return parts[0] if len(parts) == 1 else sp.csr_array(sp.hstack(parts))


def _factor(points: Array, std: float, length: float) -> sp.csr_array:
    """Of one correlation length, mm."""
    pitch = spacing_of(points)
    if length < 0.3 * pitch:
        return sp.csr_array(std * sp.eye_array(len(points)))
    step, reach = 0.7 * length, 3.2 * length
    ends = zip(points.min(axis=0) - reach, points.max(axis=0) + reach, strict=True)
    axes = [np.arange(a, b + step, step) for a, b in ends]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    pairs = cKDTree(points).sparse_distance_matrix(cKDTree(grid), reach, output_type="coo_matrix")
    pairs.data = np.exp(-(pairs.data**2) / length**2)
    factor = sp.csr_array(pairs)
    factor = factor[:, np.asarray(factor.sum(axis=0)).ravel() > 0]
    return sp.csr_array(sp.diags_array(std / np.sqrt(np.asarray((factor**2).sum(axis=1)).ravel())) @ factor)


def sample(factor: sp.csr_array, rng: np.random.Generator, n_increments: int) -> Array:
    """Noise fields (n_increments, n_nodes, 2), mm, independent per component and increment."""
    white = rng.standard_normal((factor.shape[1], 2 * n_increments))
    return np.moveaxis((factor @ white).reshape(factor.shape[0], n_increments, 2), 1, 0)


def common_sample(factor: sp.csr_array, rng: np.random.Generator, between: Array) -> Array:
    """Noise fields (t, n_nodes, 2), mm, with a covariance `between_increments` (t, t), independent per component."""
    return np.tensordot(root(between), sample(factor, rng, len(between)), 1)


def root(between: Array) -> Array:
    """R (t, t) with R R^T = between (t, t), which is singular where increments are between pictures."""
    values, vectors = np.linalg.eigh(between)
    regular = values[0] > SINGULAR * values[-1]
    return np.linalg.cholesky(between) if regular else np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def spread(system: Equilibrium, basis: Basis, c: Array, F: Array, factor: sp.csr_array | Array) -> Array:
    """K B (rows, s), N: what independent normal numbers do to the residuals of one increment. factor: see `by_sources`."""
    if not sp.issparse(factor):
        blocks = system.tangent(basis, F, c)
        return by_sources([np.concatenate([row[k].toarray() for row in blocks]) for k in range(2)], factor)
    whole = system.interleaved_stiffness(tangent_modulus(basis, F, c)) @ sp.bsr_array(factor, blocksize=(1, 1))
    return whole.toarray().reshape(-1, 2, 2 * factor.shape[1]).swapaxes(0, 1).reshape(-1, 2 * factor.shape[1])


def by_sources(rows: Sequence[Array], factor: sp.csr_array | Array) -> Array:
    """(r, 2 s): rows (r, n) by each component of the displacements, times the factor (n, s) of their noise, sparse or a lower triangle."""
    return np.hstack([one @ factor if sp.issparse(factor) else dtrmm(1.0, factor.T, one.T).T for one in rows])


def covariance_of(system: Equilibrium, spread: Array, load: Array, noise: Noise) -> Array:
    """Covariance (rows, rows), N^2, of the residuals of one increment, K Sigma_u K^T + force noise, from its spread (rows, s), N."""
    deviation = force_deviations(system, noise, load)
    return spread @ spread.T + force_correlation(system) * np.outer(deviation, deviation)


def force_correlation(system: Equilibrium) -> Array:
    """Of the errors of the measured forces, between the rows (2 v, 2 v) of an increment.

    Forces that one cell read are wrong together.
    """
    n = system.fields.n_fields
    found = np.eye(2 * n)
    loaded = np.flatnonzero(system.fields.boundary >= 0)
    for rows in (loaded, loaded + n):
        found[np.ix_(rows, rows)] -= one_cell(system.recorded[:, rows])
    return found


def force_deviations(system: Equilibrium, noise: Noise, loads: Array | None = None) -> Array:
    """Standard deviation (t, rows), N, of the noise of the load cells in the residuals; loads (t, rows), N: None for those measured."""
    forces = np.nan_to_num(system.loads if loads is None else loads)
    return np.where(np.tile(system.fields.boundary >= 0, 2), noise.force_deviation(forces), 0.0)


def own_between(experiment: Experiment, noise: Noise) -> Array:
    """(t, t): covariance of what a point's displacements have in two increments of displacement_std, over its square. Increments between pictures
    have that of the pictures, by the weights with which these are in them."""
    found, W = noise.own_between(experiment.clock[experiment.pictures]), experiment.interpolated
    return found if W is None else np.asarray(W @ found @ W.T)


def common_between(experiment: Experiment, noise: Noise) -> Array:
    """(t, c): standard deviations of what all increments have in common, over displacement_std, see `Noise.common_between`."""
    seen, W = experiment.pictures, experiment.interpolated
    found = noise.common_between(experiment.deformation_shares[seen] if noise.is_common else np.ones(len(seen)))
    return found if W is None else np.asarray(W @ found)


def between_increments(experiment: Experiment, noise: Noise) -> Array:
    """M (t, t): covariance of the noise of a point's displacements in two increments, over displacement_std^2."""
    common = common_between(experiment, noise)
    return own_between(experiment, noise) + common @ common.T


@dataclass(frozen=True, eq=False)
class EquationNoise:
    """What noise does to the equations. It is smooth in the load, so that it is known from samples (`load_path.samples`).

    spreads (k, r, s), N: what independent normal numbers do to the residuals in k samples; shares (t, k): of these in each increment. own (t, t),
    common (t, c): see `own_between`, `common_between`. correlation (r, r), deviations (t, r), N: of the load cells. pictures (t,): increments that are no
    sums of others.
    """

    spreads: Array = field(repr=False)
    shares: Array
    own: Array
    common: Array
    correlation: Array = field(repr=False)
    deviations: Array
    pictures: NDArray[np.bool_]
    _products: dict[tuple[int, int], Array] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, system: Equilibrium, noise: Noise, spreads: Array, shares: Array) -> EquationNoise:
        """Of the equations of an Experiment."""
        experiment = system.experiment
        between = own_between(experiment, noise), common_between(experiment, noise)
        pictures = np.isin(np.arange(experiment.n_increments), experiment.pictures)
        return cls(spreads, shares, *between, force_correlation(system), force_deviations(system, noise), pictures)

    @property
    def is_new_in_each(self) -> bool:
        """Whether increments have no noise in common."""
        return not (self.common.any() or self._drifts)

    @property
    def _drifts(self) -> bool:
        return bool((self.own - np.diag(np.diag(self.own))).any())

    def increment(self, i: int) -> Array:
        """Covariance (r, r), N^2, of the residuals of an increment by all noise."""
        return (self.own[i, i] + self.common[i] @ self.common[i]) * self._product(i, i) + self._of_forces(i)

    def variance(self, rows: NDArray[np.bool_]) -> Array:
        """Of each residual (t, r), N^2; 0 of those that are not used (t, r)."""
        found, size = np.zeros(rows.shape), np.diag(self.own) + (self.common**2).sum(axis=1)
        for i in np.flatnonzero(rows.any(axis=1)).tolist():
            found[i] = size[i] * self._squares(i) + self.deviations[i] ** 2
        return np.where(rows, found, 0.0)

    def own_covariance(self, i: int, j: int) -> Array:
        """Covariance (r, r), N^2, of the residuals of two increments without `sources`."""
        found = self.own[i, j] * self._product(i, j) if self.own[i, j] else np.zeros(2 * self.correlation.shape[:1])
        return found + self._of_forces(i) if i == j and not self._cells_apart[i] else found

    @cached_property
    def sources(self) -> Array:
        """(t, r, s), N: independent sources of what increments have in common, and of load cells that are not in `own_covariance`; the covariance is
        products of sources."""
        found = self._of_common()
        parts = [part[:, None, None] * found for part in self.common.T if part.any()]
        return np.concatenate([*parts, self._of_cells()], axis=2)

    def covariance(self, rows: NDArray[np.bool_]) -> Array:
        """(N, N), N^2, of the rows (t, r) that are used, by all noise."""
        some = np.flatnonzero(rows.any(axis=1)).tolist()
        ends, between = np.append(0, np.cumsum(rows.sum(axis=1))), self.own + self.common @ self.common.T
        found = np.zeros((ends[-1], ends[-1]))
        for i, j in ((i, j) for i in some for j in some if i <= j and between[i, j]):
            block = between[i, j] * self._product(i, j) + (self._of_forces(i) if i == j else 0.0)
            part = block[np.ix_(rows[i], rows[j])]
            found[ends[i] : ends[i + 1], ends[j] : ends[j + 1]] = part
            found[ends[j] : ends[j + 1], ends[i] : ends[i + 1]] = part.T
        return found

    @cached_property
    def _cells_apart(self) -> NDArray[np.bool_]:
        """(t,): whether the load cells of an increment are sources. Where displacements are correlated between increments their noise, new in each, would
        hide in each increment what the one before tells. Where displacements are known from other increments it keeps the covariance regular."""
        return self.pictures & self._drifts

    def _of_common(self) -> Array:
        """(t, r, d), N, of each part in common over its deviation. Of the space of normal numbers they span what matters to a sample and did not to those
        before it: of a variance of more than `NEGLIGIBLE` over that of displacement_std, were it in all increments."""
        if not self.common.any():
            return np.zeros((*self.deviations.shape, 0))
        least, axes = NEGLIGIBLE / float((self.common**2).sum()), np.zeros((self.spreads.shape[2], 0))
        for k in np.flatnonzero(self.shares.any(axis=0)).tolist():
            lower = cholesky_factor(self._of_samples(k, k))
            white = scipy.linalg.solve_triangular(lower, self.spreads[k], lower=True)
            axes = np.column_stack([axes, _further_axes(axes, white, least)])
        return np.tensordot(self.shares, self.spreads @ axes, 1)

    def _of_cells(self) -> Array:
        """(t, r, t f), N: of the load cells of the increments where they are sources."""
        values, vectors = np.linalg.eigh(self.correlation * np.outer(*2 * [self.deviations.any(axis=0)]))
        root = (vectors * np.sqrt(np.maximum(values, 0.0)))[:, values > SINGULAR]
        some = np.flatnonzero(self._cells_apart)
        found = np.zeros((*self.deviations.shape, len(some), root.shape[1]))
        for k, i in enumerate(some):
            found[i, :, k] = self.deviations[i][:, None] * root
        return found.reshape(*self.deviations.shape, -1)

    def residuals(self, numbers: Array, spreads: Array) -> Array:
        """Residuals (t, r), N, that numbers (t, s) make by spreads (k, r, s) of the samples."""
        return np.einsum("tk,krs,ts->tr", self.shares, spreads, numbers, optimize=True)

    def _of_samples(self, k: int, j: int) -> Array:
        if k > j:
            return self._of_samples(j, k).T
        if (k, j) not in self._products:
            self._products[k, j] = self.spreads[k] @ self.spreads[j].T
        return self._products[k, j]

    def _product(self, i: int, j: int) -> Array:
        pairs = ((k, l) for k in self._samples_of(i) for l in self._samples_of(j))
        return np.asarray(sum(self.shares[i, k] * self.shares[j, l] * self._of_samples(k, l) for k, l in pairs))

    def _squares(self, i: int) -> Array:
        """Diagonal (r,) of `_product` of an increment with itself, which costs much less."""
        some = self._samples_of(i)
        mixed = np.tensordot(self.shares[i, some], self.spreads[some], 1)
        return np.asarray((mixed**2).sum(axis=1))

    def _samples_of(self, i: int) -> list[int]:
        """Those that an increment is made of."""
        return np.flatnonzero(self.shares[i]).tolist()

    def _of_forces(self, i: int) -> Array:
        return np.asarray(self.correlation * np.outer(self.deviations[i], self.deviations[i]))


def _further_axes(axes: Array, white: Array, least: float) -> Array:
    """Orthonormal directions (s, n) beside axes (s, d) in which rows white (r, s) have a variance above `least`."""
    white = white - (white @ axes) @ axes.T
    values, vectors = np.linalg.eigh(white @ white.T)
    keep = values > least
    found = white.T @ (vectors[:, keep] / np.sqrt(values[keep]))
    return np.linalg.qr(found - axes @ (axes.T @ found))[0]  # once more, against round-off


def cholesky_factor(covariance: Array) -> Array:
    """Lower Cholesky factor of a covariance (r, r), with a floor of 1e-10 of each variance against round-off.

    Raises `FitError` for one that is not finite, as of a material that runs away.
    """
    variance = np.diag(covariance)
    try:
        if not np.isfinite(covariance).all():
            raise np.linalg.LinAlgError
        return np.linalg.cholesky(covariance + np.diag(1e-10 * variance + 1e-14 * variance.max()))
    except np.linalg.LinAlgError:
        raise FitError(RAN_AWAY) from None
