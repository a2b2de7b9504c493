"""Covariance of all parameters of a fit: functions of the base, amplitudes and shapes of effects.

In: a `Problem` and a `Fit`. Out: `Spread`: `Directions` and a root of their covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis import problem as equations
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.parameters import Variables
from calibrate.diagnosis.problem import Problem
from calibrate.effects.chain import Additions

Array = NDArray[np.float64]
ACTIVE = 1e-6  # of the largest weight, from which a function of the cone is in the base
SINGULAR = 1e-10  # of the largest eigenvalue of the information
STEP = 1e-3  # of a size, of finite differences


@dataclass(frozen=True, eq=False)
class Directions:
    """The unknowns of a model: weights of columns base (n, p) in its coefficients c (n,), then amplitudes and shapes of its effects. sizes (p + k,): of a small
    change of each."""

    c: Array
    additions: Additions
    base: Array
    sizes: Array

    @classmethod
    def of(cls, c: Array, additions: Additions, base: Array, stiffness: float) -> Directions:
        """stiffness: the largest weight of a column of the base."""
        return cls(
            c, additions, base, STEP * np.concatenate([np.full(base.shape[1], stiffness), Variables(additions).scale])
        )

    def moved(self, i: int, side: float = 1.0) -> tuple[Array, Additions]:
        """Coefficients (n,) and effects with the i-th unknown larger by its size, or smaller with a side of -1."""
        p = self.base.shape[1]
        if i < p:
            return self.c + side * self.sizes[i] * self.base[:, i], self.additions
        variables = Variables(self.additions)
        values = variables.values.copy()
        values[i - p] += side * self.sizes[i]
        return self.c, variables.at(values)


@dataclass(frozen=True, eq=False)
class Spread:
    """root (p + k, q): of the covariance of the unknowns."""

    directions: Directions
    root: Array


@dataclass(frozen=True, eq=False)
class Columns:
    """Change J (N, p + k) of the whitened residual by the unknowns of a fit: weights of columns base (n, p), then amplitudes and shapes over scale (k,). weights (p,): of the base."""

    fit: Fit
    base: Array
    J: Array = field(repr=False)
    scale: Array
    weights: Array

    @classmethod
    def of(cls, problem: Problem, fit: Fit) -> Columns:
        """Functions at their bound are held there."""
        weights = np.maximum(np.linalg.lstsq(problem.cone, fit.c, rcond=None)[0], 0.0)
        active = weights > ACTIVE * weights.max()
        base = problem.cone[:, active]
        scale = Variables(fit.additions).scale if fit.additions else np.zeros(0)
        J = equations.base_columns(problem, fit.chains) @ base
        if fit.additions:
            J = np.hstack([J, equations.signatures(problem, fit.chains, fit.c, fit.additions) * scale])
        return cls(fit, base, J, scale, weights[active])

    @property
    def dispersion(self) -> float:
        """Variance of the residuals that is reckoned with."""
        return max(1.0, self.fit.reduced_chi_square)

    @property
    def spread(self) -> Spread:
        """See `spread_of`."""
        fit, p, variables = self.fit, self.base.shape[1], Variables(self.fit.additions)
        information = self.J.T @ self.J / self.dispersion
        if fit.additions:
            information[range(p, len(information)), range(p, len(information))] += (
                self.scale / variables.shape_deviations
            ) ** 2
        root = covariance_root(information)
        if fit.additions:
            root[p:] *= _growth(root[p:], self.scale, fit, variables)[:, None]
            root[p:] *= self.scale[:, None]
        return Spread(Directions.of(fit.c, fit.additions, self.base, float(self.weights.max())), root)


def spread_of(problem: Problem, fit: Fit) -> Spread:
    """Of Gauss-Newton's information, over the dispersion, and of the priors of shapes; amplitudes as uncertain as the fit says, which allows for errors of the kinematics, too.

    Functions at their bound are held there.
    """
    return Columns.of(problem, fit).spread


def covariance_root(information: Array) -> Array:
    """R (k, q) with R R^T the inverse of an information (k, k); what it does not constrain is held."""
    size = np.sqrt(np.diag(information))
    used = size > 0
    if not used.any():
        return np.zeros((len(size), 0))
    values, vectors = np.linalg.eigh(information[np.ix_(used, used)] / np.outer(size[used], size[used]))
    keep = values > SINGULAR * values.max()
    root = np.zeros((len(size), int(keep.sum())))
    root[used] = vectors[:, keep] / np.sqrt(values[keep]) / size[used][:, None]
    return root


def _growth(root: Array, scale: Array, fit: Fit, variables: Variables) -> Array:
    """Factors (k,) on the deviations of amplitudes and shapes, to those that the fit states; shapes as they are."""
    found = np.ones(len(scale))
    stated = np.concatenate([np.array(d) for d in fit.errors]) / scale[~variables.is_shape]
    own = np.linalg.norm(root[~variables.is_shape], axis=1)
    found[~variables.is_shape] = np.maximum(stated / np.where(own > 0, own, np.inf), 1.0)
    return found
