"""What increments have in common of the noise of the displacements, and its drift, from residuals of fine virtual fields.

In: residuals over the standard deviation that unit noise would make of them, in several increments. Out: variances of the noise that stays with
the speckle pattern and of that of the reference picture, over the variance of what an increment has of its own, and the time in which that drifts (`Noise`).

Of each field a, y_a (k,) is normal with the covariance v (exp(-|t_i - t_j| / tau) + p s s^T + q 1 1^T) o R_a: s are the shares of the deformation, R_a the
correlations that one field of noise would have between increments, as the tangents differ. v, tau, p and q are those of the largest likelihood of all fields
as if they were independent (composite likelihood; Varin, Reid and Firth 2011); what it gains by them is divided by the number of fields that
say the same, the mean over fields of the sum of squared correlations with all others. Four models are compared: with p and q or without, with tau or
without. Each number must gain what chance would with a probability of 1 %. A field takes hardly a degree of freedom of the fit, so that this
is the restricted likelihood also. Fields far out (`FAR`) are left out: the material may be wrong there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from calibrate.robust_deviation import robust_std

Array = NDArray[np.float64]
FAR = 3.5  # standard deviations
SURE, SURE_OF_DRIFT = 9.2, 6.6  # of twice the logarithm of the likelihood: chi-square of two numbers, of one, 1 %
MOST = 1e4  # of a ratio
LIKEST = 0.999  # correlation between neighbours of a drift


class CommonRatios(NamedTuple):
    """pattern, reference: variances over that of what increments have of their own; pattern at a share of 1. time: in which that drifts, 0: not at all."""

    pattern: float = 0.0
    reference: float = 0.0
    time: float = 0.0

    def variances(self, shares: Array) -> Array:
        """Whole variance (k,) in increments with shares of the deformation (k,), over that of their own."""
        return np.asarray(1 + self.pattern * shares**2 + self.reference)


class _Fit(NamedTuple):
    """twice: minus twice the logarithm of the likelihood of ratios, with what each number must gain added."""

    twice: float
    ratios: CommonRatios


def common_ratios(
    y: Array, correlations: Array, shares: Array, clock: Array | None = None, repeated: float = 1.0
) -> CommonRatios:
    """Of y (a, k) with correlations (a, k, k) of one field of noise, in increments with shares (k,); none where they are not sure. clock (k,): their
    times, None: no drift is sought.

    repeated: number of fields that say the same.
    """
    if len(shares) < 2:
        return CommonRatios()
    size = robust_std(y, axis=0)
    near = (np.abs(y) < FAR * size).all(axis=1)
    clocks = (
        [None] if clock is None or len(shares) < 3 else [None, clock]
    )  # of two increments a drift is noise in common
    models = [(common, times) for common in (False, True) for times in clocks]
    fits = [_fit(y[near], correlations[near], shares, *model, repeated) for model in models]
    return min(fits, key=lambda found: found.twice).ratios


def _fit(y: Array, correlations: Array, shares: Array, common: bool, clock: Array | None, repeated: float) -> _Fit:
    """The largest likelihood with p and q or without, with tau or, where there is no clock (k,), without."""
    drift, times = clock is not None, np.arange(float(len(shares))) if clock is None else clock
    apart, unit = np.abs(np.subtract.outer(times, times)), float(np.median(np.diff(np.sort(times))))
    pattern = np.outer(shares, shares)

    def between(x: Array) -> Array:
        own = x[3] ** (apart / unit) if drift else np.eye(len(shares))
        return np.asarray(own + x[1] ** 2 * pattern + x[2] ** 2)

    def twice(x: Array) -> tuple[float, Array]:
        """Minus twice the logarithm of the likelihood, and its slopes: tr(C^-1 dC) - y^T C^-1 dC C^-1 y."""
        now = between(x)
        covariance = np.exp(x[0]) * now * correlations
        inverse = np.linalg.inv(covariance)
        solved = np.einsum("rij,rj->ri", inverse, y)
        value = float((np.linalg.slogdet(covariance)[1] + (y * solved).sum(axis=1)).sum())
        by_entry = np.exp(x[0]) * ((inverse - solved[:, :, None] * solved[:, None, :]) * correlations).sum(axis=0)
        slopes = [now, 2 * x[1] * pattern, np.full_like(pattern, 2 * x[2]),
                  apart / unit * x[3] ** (apart / unit - 1) if drift else np.zeros_like(pattern)]  # fmt: skip
        return value, np.array([(by_entry * slope).sum() for slope in slopes])

    level = float(np.log((y**2).mean()))
    size = MOST**0.5 * common
    bounds = [(level - 12, level + 2), (0.0, size), (0.0, size), (1e-6, LIKEST)]
    of_common = ((0.3, 0.3), (2.0, 0.3), (0.3, 2.0)) if common else ((0.0, 0.0),)
    of_drift = (0.3, 0.9) if drift else (0.5,)
    starts = [[level - np.log1p(a * a + b * b), a, b, rho] for a, b in of_common for rho in of_drift]
    best = min(
        (minimize(twice, start, jac=True, bounds=bounds) for start in starts), key=lambda found: float(found.fun)
    )
    if drift and (best.x[1:] >= np.array([0.99 * MOST**0.5, 0.99 * MOST**0.5, LIKEST])).any():
        return _Fit(np.inf, CommonRatios())  # beside so much in common a drift is an error of the material
    time = -unit / np.log(best.x[3]) if drift else 0.0
    ratios = CommonRatios(float(best.x[1] ** 2), float(best.x[2] ** 2), float(time))
    return _Fit(float(best.fun) + repeated * (SURE * common + SURE_OF_DRIFT * drift), ratios)
