"""What increments have in common of the noise of the displacements, from residuals of fine virtual fields.

In: residuals over the standard deviation that unit noise would make of them, in several increments. Out: variances of the noise that stays with
the speckle pattern and of that of the reference picture, over the variance of what is new in each increment (`Noise`).

Of each field a, y_a (k,) is normal with the covariance v (I + p s s^T + q 1 1^T) o R_a: s are the shares of the deformation, R_a the correlations
that one field of noise would have between increments, as the tangents differ. v, p and q are those of the largest likelihood of all fields
as if they were independent (composite likelihood; Varin, Reid and Firth 2011); what it gains by p and q is divided by the number of fields that
say the same, the mean over fields of the sum of squared correlations with all others. A field takes hardly a degree of freedom of the fit, so that this
is the restricted one also. Fields far out (`FAR`) are left out: the material may be wrong there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

Array = NDArray[np.float64]
NORMAL = 0.6745  # median of |y| of normal numbers
FAR = 3.5  # standard deviations
SURE = (
    9.2  # of twice the logarithm of the likelihood, beyond which noise counts as common: chi-square of two numbers, 1 %
)
MOST = 1e4  # of a ratio


class CommonRatios(NamedTuple):
    """pattern, reference: variances over that of what is new in each increment; pattern at a share of 1."""

    pattern: float = 0.0
    reference: float = 0.0

    def variances(self, shares: Array) -> Array:
        """Whole variance (k,) in increments with shares of the deformation (k,), over that of what is new."""
        return np.asarray(1 + self.pattern * shares**2 + self.reference)


def common_ratios(y: Array, correlations: Array, shares: Array, repeated: float = 1.0) -> CommonRatios:
    """Of y (a, k) with correlations (a, k, k) of one field of noise, in increments with shares (k,); none where they are not sure.

    repeated: number of fields that say the same.
    """
    if len(shares) < 2:
        return CommonRatios()
    size = np.median(np.abs(y), axis=0) / NORMAL
    near = (np.abs(y) < FAR * size).all(axis=1)
    y, correlations = y[near], correlations[near]
    alone = np.eye(len(shares)) * correlations
    pattern, reference = np.outer(shares, shares) * correlations, correlations

    def twice(x: Array) -> float:
        """Minus twice the logarithm of the likelihood."""
        covariance = np.exp(x[0]) * (alone + x[1] ** 2 * pattern + x[2] ** 2 * reference)
        solved = np.linalg.solve(covariance, y[:, :, None])[:, :, 0]
        return float((np.linalg.slogdet(covariance)[1] + (y * solved).sum(axis=1)).sum())

    level = float(np.log((y**2).mean()))
    bounds = [(level - 12, level + 2), (0.0, MOST**0.5), (0.0, MOST**0.5)]
    starts = ([level - np.log1p(a * a + b * b), a, b] for a, b in ((0.3, 0.3), (2.0, 0.3), (0.3, 2.0)))
    best = min((minimize(twice, start, bounds=bounds) for start in starts), key=lambda found: float(found.fun))
    if twice(np.array([level, 0.0, 0.0])) - best.fun < SURE * repeated:
        return CommonRatios()
    return CommonRatios(float(best.x[1] ** 2), float(best.x[2] ** 2))
