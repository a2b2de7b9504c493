"""Minus twice the log-likelihood of models that make different noise of the same displacements.

In: residuals of models, each over the noise that it makes itself. Out: the variance of each, or its deviance.

What was measured are displacements, and the equations are functions of them that follow the model: one that is stiffer, as rubber that relaxes is at an instant, makes larger errors of the same noise. The likelihood
is that of the displacements, so that the determinant of what a model makes of them does not enter. With r the variance of its noise, what is left beyond noise, D, is not in proportion to r and is the same for all. In
weights of its own the variance of residuals is

    (min(r, 2 r_base) + D) / r,   D the smallest of all models.

An effect makes at most twice the noise of the base, or one that is stiff and not there would make as much as it likes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrate.diagnosis.effect_fit import Fit

Array = NDArray[np.float64]
AMPLIFIED = 2.0  # variance of noise in the equations, that an effect may add to


def residual_variances(chi_square: ArrayLike, noise: ArrayLike, of_base: float = 1.0) -> Array:
    """(m,) of models, over the noise of each. chi_square (m,): of each, an equation; noise (m,), of_base: variance of the noise that they and the base make, in any unit."""
    left, noise = np.asarray(chi_square, float), np.asarray(noise, float)
    allowed = np.minimum(noise, AMPLIFIED * of_base)
    return np.asarray((allowed + max(float((noise * left - allowed).min()), 0.0)) / noise)


def deviances(fits: Sequence[Fit]) -> Array:
    """(m,) of fits of the same equations, of what no I1 energy can absorb. The first is the base."""
    noise = np.exp([(fit.log_determinant - fits[0].log_determinant) / fit.n_rows for fit in fits])
    return np.array([fit.free_loss for fit in fits]) / residual_variances([f.reduced_chi_square for f in fits], noise)
