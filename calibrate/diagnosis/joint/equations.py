"""The equations of a joint fit: work scaled to the loads, with exact derivatives, and the prior on effects and base.

In: a `Problem` and effects. Out: residuals and derivatives at any base and amplitudes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis import problem as equations_of
from calibrate.diagnosis.parameters import Variables
from calibrate.diagnosis.problem import Problem
from calibrate.effects.chain import Additions

Array = NDArray[np.float64]
Widths = Mapping[str, Array]  # of the prior: {effect: standard deviation of every amplitude (p,), in its unit}


@dataclass(frozen=True, eq=False)
class Point:
    """Weights w (n,) of the cone's columns and effects with stresses scaled to the loads; r = s g - f (N,), see `Equations.residual`.

    objective: by the prior of the point that the step began at.
    """

    w: Array
    additions: Additions
    r: Array
    s: float
    g: Array
    objective: float = np.inf


class Equations:
    """Whitened equations with the stress scaled to the loads. reach: prior standard deviations that no amplitude goes beyond."""

    def __init__(self, problem: Problem, widths: Widths, reach: float = np.inf) -> None:
        self.problem, self.widths, self.reach = replace(problem, prior=problem.prior[:0]), widths, reach
        self.smooth = problem.prior @ problem.cone
        self.chains = [part.chain for part in problem.trained]
        self.loads = equations_of.loads(self.problem)
        self.columns = equations_of.base_columns(self.problem, self.chains) @ problem.cone

    def residual(self, w: Array, additions: Additions) -> tuple[Array, float, Array]:
        """s g - f (N,), s and g (N,)."""
        g = equations_of.residual(self.problem, self.problem.cone @ w, additions) + self.loads
        product = float(g @ self.loads)
        if not product > 0:
            return np.full(len(g), np.inf), np.inf, g
        s = float(self.loads @ self.loads) / product
        return s * g - self.loads, s, g

    def prior(self, variables: Variables, dispersion: float) -> Prior:
        """That belongs to a dispersion."""
        return Prior(variables, dispersion, self.smooth, self.widths)

    def scaled(self, w: Array, additions: Additions) -> Point:
        """Both with stresses scaled to the loads, and the residual there; an effect on the loads makes it another one."""
        r, s, g = self.residual(w, additions)
        if not np.isfinite(s):
            return Point(w, additions, r, s, g)
        w, additions = s * w, _stiffer(additions, s)
        return Point(w, additions, *self.residual(w, additions))

    def projected(self, columns: Array, s: float, g: Array) -> Array:
        """Derivatives (N, k) of s g from those of g."""
        return s * (columns - np.outer(g, self.shares(columns, g)))

    def shares(self, columns: Array, g: Array) -> Array:
        """By what share (k,) all stresses are scaled down for a unit of what has the derivatives (N, k) of g."""
        return (self.loads @ columns) / float(g @ self.loads)

    def compensated(self, columns: Array, w: Array) -> Array:
        """Derivatives (N, k) of g where the base follows as a whole, so that the work still agrees with that of the loads."""
        base = self.columns @ w
        return columns - np.outer(base, self.shares(columns, base))

    def slopes(self, w: Array, additions: Additions) -> Array:
        """d g / d amplitudes and shapes (N, k)."""
        if not additions:
            return np.zeros((len(self.loads), 0))
        c = self.problem.cone @ w
        return np.asarray(self.problem.whiten([chain.jacobian(c, additions) for chain in self.chains])).T


class Prior:
    """Normal prior on the amplitudes (shapes have none), and on the base: smooth (r, n), 1 / MPa, as `Problem.prior`."""

    def __init__(self, variables: Variables, dispersion: float, smooth: Array, widths: Widths) -> None:
        self.dispersion = max(1.0, dispersion)
        self.smooth = smooth * np.sqrt(self.dispersion)
        nulls = [np.concatenate([[p.null for p in a.effect.amplitudes], a.shape]) for a in variables.additions]
        self.null = np.concatenate([np.zeros(0), *nulls])
        self.widths = _widths(variables, widths)
        self.weights = np.where(variables.is_shape, 0.0, np.sqrt(self.dispersion) / self.widths)

    def limits(self, variables: Variables, reach: float) -> tuple[Array, Array]:
        """Lower and upper (k,) of the values: no amplitude further from none than `reach` standard deviations, none outside of its own bounds."""
        width = np.where(variables.is_shape, np.inf, reach * self.widths * variables.scale)
        lower, upper = variables.bounds
        return np.maximum(lower, self.null - width), np.minimum(upper, self.null + width)

    def judged(self, point: Point) -> Point:
        """The point with its objective."""
        value = float(point.r @ point.r) + self.of(point.w, Variables(point.additions))
        return replace(point, objective=value)

    def of(self, w: Array, variables: Variables) -> float:
        """Squared distance from the null values and from a base w (n,) without stiffening, weighted."""
        bend = self.smooth @ w
        return self.of_effects(variables) + float(bend @ bend)

    def of_effects(self, variables: Variables) -> float:
        """Squared distance from the null values, weighted."""
        z = self.weights * np.where(variables.is_shape, 0.0, (variables.values - self.null) / variables.scale)
        return float(z @ z)

    def bend(self, w: Array, base: Array, effects: Array) -> Array:
        """Derivatives (r, n + k) of `smooth` w to w and effects, where base (n,) and effects (k,) scale all stresses down."""
        bend = self.smooth @ w
        return np.concatenate([self.smooth - np.outer(bend, base), -np.outer(bend, effects)], axis=1)


def _widths(variables: Variables, widths: Widths) -> Array:
    """Of every value (k,), over its scale."""
    own = [np.concatenate([widths[a.effect.name], np.ones(len(a.shape))]) for a in variables.additions]
    return np.concatenate([np.zeros(0), *own]) / variables.scale


def _stiffer(additions: Additions, factor: float) -> Additions:
    """Amplitudes in MPa times a factor, those in 1/MPa over it: every stress is as many times larger."""
    return tuple(
        replace(
            a,
            amplitudes=tuple(
                v * factor**p.stiffness_power for p, v in zip(a.effect.amplitudes, a.amplitudes, strict=True)
            ),
        )
        for a in additions
    )
