"""What the error of its formulas does to the evidence of an explanation.

In: a fit to second order. Out: its log evidence by Laplace's approximation (MacKay 1992), with all effects, or with some of them taken for an error of the formulas of the others:

    ln Z = -1/2 r^T V^-1 r - 1/2 ln |V| - 1/2 a^T (L^2 + I^-1)^-1 a - 1/2 ln |1 + L I L| + ln prior odds,   I = S^T S

The fit has no prior on amplitudes a, so that the second term is that of the posterior mode seen from there: what the data do not tell of an amplitude costs nothing. All is over the variance of the residuals. An amplitude with a bound at its
null value has a half-normal prior, as in `linear_evidence`. An effect that may have some of its amplitudes alone has the sum of the evidence of all such sets, others having L = 0.

The formula of an effect is wrong by a share eps of what it explains, at most, so that the squares of all errors add up to w = sum eps_i^2 |S_i a_i|^2, or less: Z is averaged over a
logarithmic grid of w. Errors are smooth over place and load,

    V = 1 + w / k D D^T,

with D (N, k) orthonormal; and they may look like another effect j. What that does outside of all else that the fit adjusts, S_j, then has amplitudes of the size L_j = sqrt(w) / |S_j| instead of its prior ones, and
no prior odds:

    -1/2 a_j^T (L_j^2 + I_j^-1)^-1 a_j - 1/2 ln |1 + L_j^2 I_j|,   I_j = S_j^T S_j

So an effect that is no larger than what the formula of another may be wrong by is no more probable than that error.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import special

from calibrate.fitting.least_squares import orthonormal

Array = NDArray[np.float64]
SHARES = (1.0, 0.25, 1 / 16, 1 / 64, 1 / 256)  # of its square, that the error may be


@dataclass(frozen=True, eq=False)
class FittedEffect:
    """Amplitudes a (p,) from null as they were fitted, with signatures S (N, p) outside of what the base adjusts, and prior deviations L (p,). error: of its formula, relative. log_prior: of its odds, shapes and sets of amplitudes. one_sided (p,): amplitudes that
    cannot be below null, whose prior is half-normal. sets (s, p): of amplitudes that it may have."""

    name: str
    a: Array
    S: Array = field(repr=False)
    L: Array
    error: float
    log_prior: float
    one_sided: NDArray[np.bool_]
    sets: NDArray[np.bool_]

    @property
    def square(self) -> float:
        """Of what it explains."""
        return float(np.linalg.norm(self.S @ self.a) ** 2)


@dataclass(frozen=True, eq=False)
class SecondOrder:
    """A fit to second order. chi_square: of what the base cannot absorb; smooth (k,): the residual along smooth disturbances in it; adjusted (N, q): all else that the fit adjusts, base and shapes."""

    chi_square: float
    smooth: Array = field(repr=False)
    effects: tuple[FittedEffect, ...]
    adjusted: Array = field(repr=False)

    @property
    def names(self) -> frozenset[str]:
        """Of its effects."""
        return frozenset(one.name for one in self.effects)

    def log_evidence(self, noise: float, kept: Collection[str]) -> float:
        """Up to a number that all explanations share. noise: variance of all residuals. kept: effects; the others are an error of their formulas."""
        inside = [one for one in self.effects if one.name in kept]
        errors = [one for one in self.effects if one.name not in kept]
        w = sum(one.error**2 * one.square for one in inside) / noise
        if w <= 0:
            return self.with_smooth(noise, 0.0) + _occam(inside, noise) if not errors else -np.inf
        like = self._like(inside, errors)
        each = [self._with_error(noise, share * w, like) for share in SHARES]
        return float(special.logsumexp(each) - np.log(len(SHARES))) + _occam(inside, noise)

    def with_discrepancy(self, noise: float, v: float) -> float:
        """The same of all effects with smooth disturbances of a variance v over the noise."""
        return self.with_smooth(noise, v) + _occam(self.effects, noise)

    def with_smooth(self, noise: float, v: float) -> float:
        """Of the residual alone, with such disturbances."""
        chi_square = (self.chi_square - v / (1 + v) * float(self.smooth @ self.smooth)) / noise
        return -0.5 * (chi_square + len(self.smooth) * float(np.log1p(v)))

    def _like(self, inside: Sequence[FittedEffect], errors: Sequence[FittedEffect]) -> tuple[Array, Array]:
        """Amplitudes (p,) of effects that are errors, over the size of each; their information (p, p) outside of all else."""
        if not errors:
            return np.zeros(0), np.zeros((0, 0))
        basis = orthonormal(np.concatenate([self.adjusted, *(one.S for one in inside)], axis=1))
        found = [one.S - basis @ (basis.T @ one.S) for one in errors]
        sizes = [max(float(np.linalg.norm(S)), 1e-300) for S in found]
        unit = np.concatenate([S / size for S, size in zip(found, sizes, strict=True)], axis=1)
        return np.concatenate([one.a * size for one, size in zip(errors, sizes, strict=True)]), unit.T @ unit

    def _with_error(self, noise: float, w: float, like: tuple[Array, Array]) -> float:
        """With errors whose squares add up to w over the noise."""
        a, information = like
        value = self.with_smooth(noise, w / max(len(self.smooth), 1))
        if not len(a):
            return value
        # a^T (w + I^-1)^-1 a, without an inverse of I, whose smallest directions say nothing
        M = np.eye(len(a)) + w * information
        b = information @ a
        squares = float(a @ np.linalg.solve(M.T, b)) / noise
        return value - 0.5 * (squares + float(np.linalg.slogdet(M)[1]))


def _occam(effects: Sequence[FittedEffect], noise: float) -> float:
    """What they cost: prior and volume."""
    if not effects:
        return 0.0
    S, a, L, sided = (
        np.concatenate([getattr(one, key) for one in effects], axis=-1) for key in ("S", "a", "L", "one_sided")
    )
    information = S.T @ S / noise
    each = [
        _with_prior(information, a, L * np.concatenate(some), sided) for some in product(*(one.sets for one in effects))
    ]
    return float(special.logsumexp(each)) + sum(one.log_prior for one in effects)


def _with_prior(information: Array, a: Array, L: Array, sided: NDArray[np.bool_]) -> float:
    """Of amplitudes a (p,) with information (p, p) and prior deviations L (p,)."""
    M = np.eye(len(a)) + L[:, None] * information * L
    right = L * (information @ a)
    mean, covariance = np.linalg.solve(M, right), np.linalg.inv(M)
    prior = float(a @ information @ a - right @ mean)  # a^T (L^2 + I^-1)^-1 a
    admissible = (np.log(2) + special.log_ndtr(mean / np.sqrt(np.diag(covariance))))[sided]
    return -0.5 * (prior + float(np.linalg.slogdet(M)[1])) + float(admissible.sum())
