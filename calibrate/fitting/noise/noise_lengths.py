"""Correlation length of the noise of the displacements, or two of them, from fields of several distances.

In: an Experiment, a material. Out: noise of 1 mm that is correlated as that of the Experiment.

Noise of a short correlation length is felt most by fine virtual fields, that of a long one by coarse ones, too. So is an error of the material, but that
changes smoothly with the deformation. Looked at is what the residual of an increment is beside the one interpolated between its neighbours, over what
unit noise would make of it: standard deviations of fields of all `DISTANCES` agree where the lengths are right. One length or two of `LENGTHS` and
the share of the second are those of the least sum of squares of the logarithms of these standard deviations about their mean, each over its error.

Two lengths describe what one does not: kernels with a peak or a long tail, as of an exponential, or noise of points each for itself beside that of subsets.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment, Noise
from calibrate.equations.basis import Basis
from calibrate.equations.noise_covariance import noise_factor
from calibrate.fitting.noise.fine_fields import FINE, FineFields, evenly, pitch
from calibrate.robust_deviation import robust_std

Array = NDArray[np.float64]
DISTANCES = (FINE, 2.0, 2.8, 4.0, 5.6)  # of virtual fields over that of the points
LENGTHS = (0.0, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)  # that are tried, over the distance of the points
SHARES = tuple(k / 10 for k in range(1, 10))  # of the variance, of the longer one of two
FURTHEST = 3.0  # ratio of two lengths
NOT_SEEN = 0.5  # length that is as none, over the distance of the points
PLACES, MOST_ROWS = 4, 500  # groups of three increments, and fields of each distance, at most
FEWEST = 100  # values


def correlated_unit(experiment: Experiment, basis: Basis, c: Array) -> Noise:
    """Noise of 1 mm; without correlation where too few points are there to tell. Of fewer than three increments the residual itself is looked at."""
    step = pitch(experiment)
    lengths = step * np.array(LENGTHS)
    factors = [noise_factor(experiment, Noise(1.0, float(length))) for length in lengths]
    seen = [_seen(experiment, distance, basis, c, factors) for distance in DISTANCES]
    used = [one for one in seen if one is not None]
    if len(used) < 2:
        return Noise(1.0)
    shares = min(_candidates(), key=lambda shares: _disagreement(used, shares))
    short, *longer = np.flatnonzero(shares).tolist()
    second = {"second_length": float(lengths[longer[0]]), "second_share": float(shares[longer[0]])} if longer else {}
    return Noise(1.0, float(lengths[short]), **second)


def _candidates() -> Iterator[Array]:
    """Shares of the variance (lengths,) of each of `LENGTHS`."""
    one = np.eye(len(LENGTHS))
    yield from one
    for i, short in enumerate(LENGTHS):
        for j in range(i + 1, len(LENGTHS)):
            if LENGTHS[j] <= FURTHEST * max(short, NOT_SEEN):
                yield from ((1 - share) * one[i] + share * one[j] for share in SHARES)


def _seen(
    experiment: Experiment, distance: float, basis: Basis, c: Array, factors: Sequence[sp.csr_array]
) -> tuple[Array, Array] | None:
    """Residuals (w, r), N, beside those of the neighbours, and their variances (factors, w, r), N^2, by noise with these factors (n, s); None where they are too few."""
    before = 2 if experiment.n_increments > 2 else 0
    fine = FineFields.of(experiment, distance, basis, c, PLACES, before, MOST_ROWS)
    if fine is None:
        return None
    weights = (
        _beside_neighbours(experiment.deformation_shares, fine.increments, evenly(experiment, PLACES))
        if before
        else np.eye(len(fine.increments))
    )
    most = np.abs(weights).argmax(axis=1).tolist()  # the middle one: neighbours differ by little
    sizes = (weights**2).sum(axis=1)[:, None]
    variances = np.array([sizes * fine.variances_of(factor, most) for factor in factors])
    residuals = weights @ fine.residuals
    return (residuals, variances) if residuals.size >= FEWEST else None


def _beside_neighbours(shares: Array, increments: NDArray[np.int64], last: NDArray[np.int64]) -> Array:
    """Weights (w, k) of the increments (k,): of three neighbours of which the last is one of `last`, the middle one less what lies between the other two,
    linearly in the path of the shares (t,) of the deformation."""
    path = np.append(0.0, np.cumsum(np.abs(np.diff(shares))))[increments]
    rows = []
    for i in np.flatnonzero((increments[2:] - increments[:-2] == 2) & np.isin(increments[2:], last)):
        way = path[i + 2] - path[i]
        near = (path[i + 1] - path[i]) / way if way > 0 else 0.5
        rows.append(np.zeros(len(path)))
        rows[-1][i : i + 3] = near - 1, 1.0, -near
    return np.array(rows)


def _disagreement(seen: Sequence[tuple[Array, Array]], shares: Array) -> float:
    """Sum of squares of the logarithms of the standard deviations about their mean, over the number of residuals of each."""
    logs = np.log(
        [robust_std(residuals / np.sqrt(np.tensordot(shares, variances, 1))) for residuals, variances in seen]
    )
    weights = np.array([float(residuals.size) for residuals, _ in seen])
    return float(weights @ (logs - np.average(logs, weights=weights)) ** 2)
