"""Base and many effects fitted at once, from exact derivatives.

In: a `Problem` and effects at their starting values. Out: `Joint`.

Where several effects disturb everything at like size, adding one at a time ends elsewhere for every order, because each absorbs
what belongs to those that are still missing. So all are fitted together. A normal prior keeps what the data hardly see from running away (ridge;
Hoerl and Kennard 1970).

The noise of the equations grows with the stiffness, so that a fit with fixed weights would pull it to zero. Here all stresses are
scaled by the factor s that makes internal and external work agree, s = f.f / g.f of the whitened work g and loads f, and
|s g - f|^2 is minimised by Levenberg's and Marquardt's method with exact derivatives. A step is judged after s has been made 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.diagnosis.joint.equations import Equations, Point, Prior, Widths
from calibrate.diagnosis.parameters import Variables, n_parameters
from calibrate.diagnosis.problem import Problem
from calibrate.effects.chain import Additions
from calibrate.fitting import gauss_newton, least_squares
from calibrate.fitting.gauss_newton import Damping
from calibrate.fitting.stopping import Stop

Array = NDArray[np.float64]
STEPS = 100
STARTS = (1.0, 0.1, 0.01, 1e-3, 1e-4)  # shares of the amplitudes that a fit starts with, the first that is finite
TOLERANCE = 0.02  # fall of the misfit in a step, over the dispersion


@dataclass(frozen=True, eq=False)
class Joint:
    """A fit. c (n,), MPa; additions: all effects.

    loss: |g - f|^2 of n_rows equations by n_base functions of the base; objective: with the prior. deviations: a standard
    deviation of each amplitude, the prior included. costs: rise of the loss without each effect, to first order. r_squared:
    share of what each changes that the others could do. stop: why the iteration ended.
    """

    c: Array
    additions: Additions
    loss: float
    objective: float
    n_rows: int
    n_base: int
    deviations: dict[str, tuple[float, ...]]
    costs: dict[str, float]
    r_squared: dict[str, float]
    stop: Stop

    @property
    def converged(self) -> bool:
        """Whether it ended at a minimum."""
        return self.stop is Stop.CONVERGED

    @property
    def errors(self) -> tuple[tuple[float, ...], ...]:
        """Standard deviations in the order of `additions`."""
        return tuple(self.deviations[a.effect.name] for a in self.additions)

    @property
    def present(self) -> Additions:
        """Effects that are not at their null values."""
        return tuple(
            a
            for a in self.additions
            if any(v != p.null for v, p in zip(a.amplitudes, a.effect.amplitudes, strict=True))
        )

    @property
    def dispersion(self) -> float:
        """Misfit an equation, by degrees of freedom; 1 is noise."""
        return self.loss / max(self.n_rows - self.n_base - sum(map(n_parameters, self.additions)), 1)


@dataclass(frozen=True, eq=False)
class _Linearised:
    """The equations linearised about a point: A (N, n) by the base, S (N, k) by values over their scale, bend (r, n + k) of the prior
    on the base."""

    equations: Equations
    point: Point
    variables: Variables
    prior: Prior
    A: Array
    S: Array
    bend: Array
    slack: float = 0.0

    def solve(self, damping: float) -> Array:
        """New weights of the base and values over their scale (n + k,), in bounds; what is not used stays."""
        variables, prior, A, S, w, r = self.variables, self.prior, self.A, self.S, self.point.w, self.point.r
        scale, n, k = variables.scale, len(w), len(variables.values)
        lower, upper = (end / scale for end in prior.limits(variables, self.equations.reach))
        x = np.clip(variables.values / scale, lower, upper)
        moves = S.any(axis=0)
        free = np.concatenate([np.full(n, n > 1), moves])  # a single base function has s alone
        J = np.concatenate([A, S], axis=1)
        pull = np.concatenate([np.zeros((k, n)), np.diag(prior.weights)], axis=1)
        damp = np.diag(np.sqrt(damping) * np.linalg.norm(J, axis=0))
        now, null = np.concatenate([w, x]), np.concatenate([w, prior.null / scale])
        rows = np.concatenate([J, self.bend, pull, damp])
        fixed = np.where(free, 0.0, now)
        targets = [J @ now - r, self.bend @ now - prior.smooth @ w, pull @ null, damp @ now]
        target = np.concatenate(targets) - rows @ fixed
        low, high = np.concatenate([np.zeros(n), lower]), np.concatenate([np.full(n, np.inf), upper])
        now[free] = least_squares.bounded(rows[:, free], target, low[free], high[free])
        return now

    def moved(self, unknowns: Array, fraction: float) -> Point:
        """The point at the unknowns (n + k,); steps are damped, not cut."""
        n = len(self.point.w)
        moved = self.equations.scaled(unknowns[:n], self.variables.at(unknowns[n:] * self.variables.scale))
        return self.prior.judged(moved)

    def is_small(self, unknowns: Array, moved: Point) -> bool:
        """Whether the objective fell by less than `TOLERANCE` dispersions."""
        return self.point.objective - moved.objective < TOLERANCE * self.prior.dispersion

    def is_minimum(self, unknowns: Array) -> bool:
        """Whether the objective would fall by less than `TOLERANCE` dispersions, if the equations were linear."""
        w, n = self.point.w, len(self.point.w)
        change = unknowns - np.concatenate([w, self.variables.values / self.variables.scale])
        linear = self.point.r + self.A @ change[:n] + self.S @ change[n:]
        after = np.concatenate([linear, self.prior.smooth @ w + self.bend @ change])
        moved = Variables(self.variables.at(unknowns[n:] * self.variables.scale))
        fall = self.point.objective - float(after @ after) - self.prior.of_effects(moved)
        return bool(fall < TOLERANCE * self.prior.dispersion)


def fit(
    problem: Problem,
    c: Array,
    additions: Additions,
    widths: Widths,
    steps: int = STEPS,
    reach: float = np.inf,
) -> Joint:
    """Base, amplitudes and shapes together; c (n,): where it starts. widths: of the prior; reach: of these no amplitude goes beyond. Raises `FitError` where the start is not
    finite."""
    equations = Equations(problem, widths, reach)
    if np.isfinite(reach):
        variables = Variables(additions)
        additions = variables.at(np.clip(variables.values, *equations.prior(variables, 1.0).limits(variables, reach)))
    w = np.maximum(np.linalg.lstsq(problem.cone, c, rcond=None)[0], 0.0)
    start = _finite_start(equations, w, additions)
    found = gauss_newton.minimise(lambda point, _: _linearised(equations, point), start, Damping(), steps)
    return _finished(equations, found.point, found.reason)


def _finite_start(equations: Equations, w: Array, additions: Additions) -> Point:
    """Typical amplitudes together may be too much, such as fibres that stiffen where smoothing makes strains at holes larger still: less of all, then.
    Raises `FitError`."""
    for share in STARTS:
        start = equations.scaled(w, tuple(a.nearer_null(share) for a in additions))
        if np.isfinite(start.r).all():
            return start
    raise errors.FitError("the joint fit has no finite start: check forces and their signs")


def _linearised(equations: Equations, point: Point) -> _Linearised:
    """The problem about a point, with the prior that belongs to its dispersion."""
    variables = Variables(point.additions)
    dispersion = float(point.r @ point.r) / len(point.r)
    prior = equations.prior(variables, dispersion)
    S = equations.slopes(point.w, point.additions) * variables.scale
    bend = prior.bend(point.w, equations.shares(equations.columns, point.g), equations.shares(S, point.g))
    S, A = (equations.projected(columns, point.s, point.g) for columns in (S, equations.columns))
    return _Linearised(equations, prior.judged(point), variables, prior, A, S, bend)


def _finished(equations: Equations, point: Point, stop: Stop) -> Joint:
    """The fit with the uncertainty of its amplitudes, and what each effect is worth."""
    w, additions = point.w, point.additions
    r = equations.residual(w, additions)[0]
    variables = Variables(additions)
    loss = float(r @ r)
    prior = equations.prior(variables, loss / len(r))
    S = equations.compensated(equations.slopes(w, additions) * variables.scale, w)
    S = np.concatenate([S, np.diag(prior.weights)])
    A = equations.compensated(equations.columns, w) if len(w) > 1 else np.zeros((len(r), 0))
    A = np.concatenate([A, np.zeros((len(variables.values), A.shape[1]))])
    deviations: dict[str, tuple[float, ...]] = {}
    costs, r_squared = {}, {}
    x = (variables.values - prior.null) / variables.scale
    starts = np.concatenate([[0], np.cumsum(variables.sizes)]).astype(int)
    for a, start, end in zip(additions, starts, starts[1:], strict=False):
        own = np.arange(start, start + len(a.amplitudes))
        others = np.concatenate([A, S[:, :start], S[:, end:], S[:, own[-1] + 1 : end]], axis=1)
        Q = least_squares.orthonormal(others) if others.any() else np.zeros((len(S), 0))
        outside = S[:, own] - Q @ (Q.T @ S[:, own])
        M = outside.T @ outside / prior.dispersion
        spread = np.sqrt(np.maximum(np.diag(np.linalg.pinv(M)), 0.0)) * variables.scale[own]
        deviations[a.effect.name] = tuple(map(float, spread))
        change, whole = outside @ x[own], S[:, own] @ x[own]
        costs[a.effect.name] = float(change @ change)
        r_squared[a.effect.name] = 1 - costs[a.effect.name] / max(float(whole @ whole), 1e-300)
    return Joint(
        equations.problem.cone @ w,
        additions,
        loss,
        loss + prior.of(w, variables),
        len(r),
        len(w),
        deviations,
        costs,
        r_squared,
        stop,
    )
