"""Displacement noise as a linear map of independent normal numbers, and what it does to the equations.

In: points and a `Noise`. Out: a sparse factor B (n_nodes, n_sources) with B B^T = covariance of one component,
samples of the field, and the covariance of the residuals.

A squared-exponential field is the convolution of white noise with a Gaussian of length l / sqrt(2); sources on
a grid of 0.7 l reproduce its covariance to 3e-4, whatever the number of points.

Noise that is common to increments i and j (`Noise`) correlates their equations: with B that of what is new in each and M the covariance
between increments over it, the covariance of their residuals is M_ij K_i B B^T K_j^T.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibrate.data.experiment import Experiment, Noise
from calibrate.equations.basis import Basis
from calibrate.equations.equilibrium import Equilibrium
from calibrate.errors import ConfigError, FitError

Array = NDArray[np.float64]
MOST_ROWS = 15_000  # of one covariance: 1.8 GB
ONE_CELL = 1e-7  # sum of two forces over their size, below which one load cell read both
SINGULAR = 1e-10  # smallest over largest variance of a sum of increments


def default_noise(experiment: Experiment, spacing: float) -> Noise:
    """Stand-in where the noise is unknown: only the relative weight of the equations follows from it.

    Displacements to 1e-4 of the extent, correlated over a fifth of the virtual-field spacing; forces to 1e-4.
    """
    extent = float(np.ptp(experiment.points, axis=0).max())
    return Noise(1e-4 * extent, spacing / 5, 1e-4)


def noise_factor(points: Array, noise: Noise) -> sp.csr_array:
    """B (n_nodes, n_sources), mm, with B B^T = std^2 exp(-r^2 / (2 l^2)); std times identity where l is below the
    distance of the points."""
    std, length = noise.displacement_std, noise.correlation_length
    pitch = float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))
    if length < 0.3 * pitch:
        return sp.csr_array(std * sp.eye_array(len(points)))
    step, reach = 0.7 * length, 3.2 * length
    low, high = points.min(axis=0) - reach, points.max(axis=0) + reach
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    pairs = cKDTree(points).sparse_distance_matrix(cKDTree(grid), reach, output_type="coo_matrix")
    pairs.data = np.exp(-(pairs.data**2) / length**2)
    factor = sp.csr_array(pairs)
    factor = factor[:, np.asarray(factor.sum(axis=0)).ravel() > 0]
    scale = std / np.sqrt(np.asarray((factor**2).sum(axis=1)).ravel())
    return sp.csr_array(sp.diags_array(scale) @ factor)


def gradient_axes(gradient: sp.csr_array, factor: Any) -> Array:
    """Axes (m, 2, 2), in columns, of the covariance of a displacement component's gradient in each triangle.

    gradient (2 m, n): operator; factor (n, s): see `noise_factor`.
    """
    spread = sp.csr_array(gradient @ factor)
    x, y = spread[0::2], spread[1::2]
    xy = np.asarray((x * y).sum(axis=1)).ravel()
    square = [np.asarray((part * part).sum(axis=1)).ravel() for part in (x, y)]
    covariance = np.stack([np.stack([square[0], xy], axis=1), np.stack([xy, square[1]], axis=1)], axis=1)
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]


def sample(factor: sp.csr_array, rng: np.random.Generator, n_increments: int) -> Array:
    """Noise fields (n_increments, n_nodes, 2), mm, independent per component and increment."""
    white = rng.standard_normal((factor.shape[1], 2 * n_increments))
    return np.moveaxis((factor @ white).reshape(factor.shape[0], n_increments, 2), 1, 0)


def common_sample(factor: sp.csr_array, rng: np.random.Generator, between: Array) -> Array:
    """Noise fields (t, n_nodes, 2), mm, with a covariance `between_increments` (t, t), independent per component."""
    return np.asarray(np.einsum("ij,jnk->ink", _root(between), sample(factor, rng, len(between))))


def _root(between: Array) -> Array:
    """R (t, t) with R R^T = between (t, t), which is singular where increments are between pictures."""
    values, vectors = np.linalg.eigh(between)
    if values[0] > SINGULAR * values[-1]:
        return np.linalg.cholesky(between)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def spread(system: Equilibrium, basis: Basis, c: Array, F: Array, factor: sp.csr_array) -> Array:
    """K B (rows, s), N: what independent normal numbers do to the residuals of one increment."""
    blocks = system.tangent(basis, F, c)
    return np.concatenate([np.hstack([(block @ factor).toarray() for block in row]) for row in blocks])


def covariance_of(system: Equilibrium, spread: Array, load: Array, noise: Noise) -> Array:
    """Covariance (rows, rows), N^2, of the residuals of one increment, K Sigma_u K^T + force noise, from its spread (rows, s), N."""
    return spread @ spread.T + _force_covariance(system, force_correlation(system), load, noise)


def force_correlation(system: Equilibrium) -> Array:
    """Of the errors of the measured forces, between the rows (2 v, 2 v) of an increment.

    Forces that are opposite in every increment, to more digits than a load cell has, were read by one cell, and are wrong together.
    """
    forces, n = np.nan_to_num(system.recorded), system.fields.n_fields
    found = np.eye(2 * n)
    loaded = np.flatnonzero(system.fields.boundary >= 0)
    for rows in (loaded, loaded + n):
        sums = np.abs(forces[:, rows, None] + forces[:, None, rows]).max(axis=0, initial=0.0)
        found[np.ix_(rows, rows)] -= sums < ONE_CELL * np.abs(forces[:, rows]).max(axis=0, initial=0.0)
    return found


def _force_covariance(system: Equilibrium, correlation: Array, load: Array, noise: Noise) -> Array:
    """Of the noise of the load cells in the residuals (rows,) of one increment, (rows, rows), N^2."""
    of_size = np.nan_to_num(noise.force_std_relative * np.abs(load))
    deviation = of_size + noise.force_std * np.tile(system.fields.boundary >= 0, 2)
    return np.asarray(correlation * np.outer(deviation, deviation))


def between_increments(experiment: Experiment, noise: Noise) -> Array:
    """M (t, t): covariance of the noise of a point's displacements in two increments, over displacement_std^2. Increments between pictures have
    that of the pictures, by the weights with which these are in them."""
    seen = experiment.pictures
    found = noise.between_increments(experiment.deformation_shares[seen] if noise.is_common else np.ones(len(seen)))
    W = experiment.interpolated
    return found if W is None else np.asarray(W @ found @ W.T)


def groups(between: Array) -> list[slice]:
    """Increments that have no noise in common with others: each by itself, or all together."""
    independent = not (between - np.diag(np.diag(between))).any()
    return [slice(i, i + 1) for i in range(len(between))] if independent else [slice(0, len(between))]


def stacked(spreads: Iterable[Array], k: int) -> Array:
    """Spreads (k, r, s) of samples, of k of them (r, s), as they come: they are never held twice."""
    found: Array | None = None
    for i, one in enumerate(spreads):
        found = np.empty((k, *one.shape)) if found is None else found
        found[i] = one
    assert found is not None
    return found


def products(one: Array, other: Array) -> Array:
    """Covariance (k, r, k, r) of what the same noise does by spreads of k samples, (k, r, s) each."""
    k, r, s = one.shape
    return np.asarray(one.reshape(k * r, s) @ other.reshape(k * r, s).T).reshape(k, r, k, r)


def correlated_products(of_samples: Array, shares: Array, between: Array) -> Array:
    """Covariance (g r, g r) of g increments, of that of k samples (k, r, k, r), shares (g, k) of these in each, and between (g, g)."""
    used = np.flatnonzero(shares.any(axis=0))
    some, shares = of_samples[used][:, :, used], shares[:, used]
    found = np.tensordot(np.tensordot(shares, some, (1, 0)), shares, (2, 1)).transpose(0, 1, 3, 2)
    found = np.ascontiguousarray(found) * between[:, None, :, None]
    return found.reshape(found.shape[0] * found.shape[1], -1)


def grouped_covariances(
    system: Equilibrium, of_samples: Array, shares: Array, between: Array, noise: Noise
) -> Iterator[Array]:
    """Covariance, N^2, of the residuals of each of `groups`: (2 v, 2 v) of one increment, or (t 2 v, t 2 v) of all.

    What noise does is smooth in the load, so that it is known from samples (`load_path.samples`): of_samples (k, 2 v, k, 2 v), see `products`;
    shares (t, k) of these in every increment. between (t, t): see `between_increments`. Raises `ConfigError` where one of all is too large.
    """
    rows, together = system.loads.shape[1], len(system.loads[groups(between)[0]])
    if together > 1 and together * rows > MOST_ROWS:
        raise ConfigError(
            f"{system.experiment.name}: its {together} pictures have noise in common, so that their {together * rows} equations have one "
            f"covariance ({8e-9 * (together * rows) ** 2:.1f} GB); use fewer: --pictures {MOST_ROWS // rows}"
        )
    correlation = force_correlation(system)
    for group in groups(between):
        covariance = correlated_products(of_samples, shares[group], between[group, group])
        blocks = covariance.reshape(len(shares[group]), system.loads.shape[1], len(shares[group]), -1)
        for i, load in enumerate(system.loads[group]):
            blocks[i, :, i] += _force_covariance(system, correlation, load, noise)
        yield covariance


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
        raise FitError(
            "the noise of the equations cannot be computed: the stiffness of the material ran away; check forces and their signs, and "
            "the largest strains"
        ) from None
