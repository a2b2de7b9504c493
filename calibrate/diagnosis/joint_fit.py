"""Base and many effects fitted at once, from exact derivatives.

In: a `Problem` and effects at their starting values. Out: `Joint`.

Where several effects disturb everything at like size, adding one at a time ends elsewhere for every order, because each absorbs
what belongs to those that are still missing. So all are fitted together. A weak normal prior of `PRIOR` typical amplitudes keeps
what the data hardly see from running away (ridge; Hoerl and Kennard 1970).

The noise of the equations grows with the stiffness, so that a fit with fixed weights would pull it to zero. Here all stresses are
scaled by the factor s that makes internal and external work agree, s = f.f / g.f of the whitened work g and loads f, and
|s g - f|^2 is minimised by Levenberg's and Marquardt's method with exact derivatives. A step is judged after s has been made 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.diagnosis import problem as equations_of
from calibrate.diagnosis.parameters import Variables, n_parameters
from calibrate.diagnosis.problem import Problem
from calibrate.effects.chain import Addition, Additions
from calibrate.fitting import gauss_newton, least_squares
from calibrate.fitting.gauss_newton import Damping
from calibrate.fitting.stopping import Stop

Array = NDArray[np.float64]
PRIOR = 3.0  # typical amplitudes: standard deviation of the prior
STEPS = 100
TOLERANCE = 0.02  # fall of the misfit in a step, over the dispersion


@dataclass(frozen=True, eq=False)
class Joint:
    """A fit. c (n,), MPa; additions: all candidates, those taken out at their null values; active: names of the others.

    loss: |g - f|^2 of n_rows equations by n_base functions of the base; objective: with the prior. deviations: a standard
    deviation of each amplitude, the prior included. costs: rise of the loss without each active effect, to first order. imitated:
    share of what each changes that the others could do. stop: why the iteration ended. out: what was taken out last.
    """

    c: Array
    additions: Additions
    active: frozenset[str]
    loss: float
    objective: float
    n_rows: int
    n_base: int
    deviations: dict[str, tuple[float, ...]]
    costs: dict[str, float]
    imitated: dict[str, float]
    stop: Stop
    out: str | None = None

    @property
    def converged(self) -> bool:
        """Whether it ended at a minimum."""
        return self.stop is Stop.CONVERGED

    @property
    def present(self) -> Additions:
        """The additions that are in the model."""
        return tuple(a for a in self.additions if a.effect.name in self.active)

    @property
    def errors(self) -> tuple[tuple[float, ...], ...]:
        """Standard deviations in the order of `present`."""
        return tuple(self.deviations[a.effect.name] for a in self.present)

    @property
    def dispersion(self) -> float:
        """Misfit an equation, by degrees of freedom; 1 is noise."""
        return self.loss / max(self.n_rows - self.n_base - sum(map(n_parameters, self.present)), 1)

    def penalty(self, names: Sequence[str]) -> float:
        """log(n) for every parameter of some effects (BIC; Schwarz 1978)."""
        sizes = sum(n_parameters(a) for a in self.additions if a.effect.name in names)
        return sizes * float(np.log(self.n_rows))


class _Equations:
    """Whitened equations with the stress scaled to the loads; effects that are not active, at their null values, take no part."""

    def __init__(self, problem: Problem, active: frozenset[str]) -> None:
        self.problem, self.active = problem, active
        self.chains = [part.chain for part in problem.trained]
        self.loads = equations_of.loads(problem)
        self.columns = equations_of.base_columns(problem, self.chains) @ problem.cone

    def residual(self, w: Array, additions: Additions) -> tuple[Array, float, Array]:
        """s g - f (N,), s and g (N,)."""
        g = equations_of.residual(self.problem, self.problem.cone @ w, self.present(additions)) + self.loads
        product = float(g @ self.loads)
        if not product > 0:
            return np.full(len(g), np.inf), np.inf, g
        s = float(self.loads @ self.loads) / product
        return s * g - self.loads, s, g

    def present(self, additions: Additions) -> Additions:
        """Those that are active."""
        return tuple(a for a in additions if a.effect.name in self.active)

    def scaled(self, w: Array, additions: Additions) -> _Point:
        """Both with stresses scaled to the loads, and the residual there; an effect on the loads makes it another one."""
        r, s, g = self.residual(w, additions)
        if not np.isfinite(s):
            return _Point(w, additions, r, s, g)
        w, additions = s * w, _stiffer(additions, s)
        return _Point(w, additions, *self.residual(w, additions))

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

    def slopes(self, w: Array, additions: Additions, used: NDArray[np.bool_]) -> Array:
        """d g / d amplitudes and shapes (N, k), zero where not `used`."""
        c, present = self.problem.cone @ w, self.present(additions)
        S = np.zeros((len(self.loads), len(used)))
        if present:
            S[:, used] = self.problem.whiten([chain.jacobian(c, present) for chain in self.chains]).T
        return S


class _Prior:
    """Normal prior on the amplitudes of active effects, in units of typical ones (shapes have none), and on the base: smooth (r, n),
    1 / MPa, as `Problem.prior`."""

    def __init__(self, variables: Variables, active: frozenset[str], dispersion: float, smooth: Array) -> None:
        self.dispersion = max(1.0, dispersion)
        self.smooth = smooth * np.sqrt(self.dispersion)
        self.used = np.concatenate(
            [np.full(n, a.effect.name in active) for a, n in zip(variables.additions, variables.sizes, strict=True)]
        )
        self.null = np.concatenate(
            [np.concatenate([[p.null for p in a.effect.amplitudes], a.shape]) for a in variables.additions]
        )
        self.weights = np.where(variables.is_shape | ~self.used, 0.0, np.sqrt(self.dispersion) / PRIOR)

    def judged(self, point: _Point) -> _Point:
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


@dataclass(frozen=True, eq=False)
class _Point:
    """Weights w (n,) of the cone's columns and effects with stresses scaled to the loads; r = s g - f (N,), see `_Equations.residual`.

    objective: by the prior of the point that the step began at.
    """

    w: Array
    additions: Additions
    r: Array
    s: float
    g: Array
    objective: float = np.inf


@dataclass(frozen=True, eq=False)
class _Linearised:
    """The equations linearised about a point: A (N, n) by the base, S (N, k) by values over their scale, bend (r, n + k) of the prior
    on the base."""

    equations: _Equations
    point: _Point
    variables: Variables
    prior: _Prior
    A: Array
    S: Array
    bend: Array
    slack: float = 0.0

    def solve(self, damping: float) -> Array:
        """New weights of the base and values over their scale (n + k,), in bounds; what is not used stays."""
        variables, prior, A, S, w, r = self.variables, self.prior, self.A, self.S, self.point.w, self.point.r
        scale, n, k = variables.scale, len(w), len(variables.values)
        lower, upper = (end / scale for end in variables.bounds)
        x = np.clip(variables.values / scale, lower, upper)
        moves = prior.used & S.any(axis=0)
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

    def moved(self, unknowns: Array, fraction: float) -> _Point:
        """The point at the unknowns (n + k,); steps are damped, not cut."""
        n = len(self.point.w)
        moved = self.equations.scaled(unknowns[:n], self.variables.at(unknowns[n:] * self.variables.scale))
        return self.prior.judged(moved)

    def is_small(self, unknowns: Array, moved: _Point) -> bool:
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


def fit(problem: Problem, c: Array, additions: Additions, active: frozenset[str], out: str | None = None) -> Joint:
    """Base, amplitudes and shapes of the active effects together; c (n,): where it starts. Raises `FitError` where the start is not
    finite."""
    equations = _Equations(problem, active)
    additions = tuple(a if a.effect.name in active else at_null(a) for a in additions)
    w = np.maximum(np.linalg.lstsq(problem.cone, c, rcond=None)[0], 0.0)
    start = equations.scaled(w, additions)
    if not np.isfinite(start.r).all():
        raise errors.FitError("the joint fit has no finite start: check forces and their signs")
    found = gauss_newton.minimise(lambda point, _: _linearised(equations, point), start, Damping(), STEPS)
    return _finished(equations, found.point, found.reason, out)


def _linearised(equations: _Equations, point: _Point) -> _Linearised:
    """The problem about a point, with the prior that belongs to its dispersion."""
    variables = Variables(point.additions)
    dispersion = float(point.r @ point.r) / len(point.r)
    prior = _Prior(variables, equations.active, dispersion, equations.problem.prior)
    S = equations.slopes(point.w, point.additions, prior.used) * variables.scale
    bend = prior.bend(point.w, equations.shares(equations.columns, point.g), equations.shares(S, point.g))
    S, A = (equations.projected(columns, point.s, point.g) for columns in (S, equations.columns))
    return _Linearised(equations, prior.judged(point), variables, prior, A, S, bend)


def _finished(equations: _Equations, point: _Point, stop: Stop, out: str | None) -> Joint:
    """The fit with the uncertainty of its amplitudes, and what each effect is worth."""
    w, additions = point.w, point.additions
    r = equations.residual(w, additions)[0]
    variables = Variables(additions)
    loss = float(r @ r)
    prior = _Prior(variables, equations.active, loss / len(r), equations.problem.prior)
    S = equations.compensated(equations.slopes(w, additions, prior.used) * variables.scale, w)
    S = np.concatenate([S, np.diag(prior.weights)])
    A = equations.compensated(equations.columns, w) if len(w) > 1 else np.zeros((len(r), 0))
    A = np.concatenate([A, np.zeros((len(variables.values), A.shape[1]))])
    deviations: dict[str, tuple[float, ...]] = {}
    costs, imitated = {}, {}
    x = (variables.values - prior.null) / variables.scale
    starts = np.concatenate([[0], np.cumsum(variables.sizes)]).astype(int)
    for a, start, end in zip(additions, starts, starts[1:], strict=False):
        if a.effect.name not in equations.active:
            continue
        own = np.arange(start, start + len(a.amplitudes))
        others = np.concatenate([A, S[:, :start], S[:, end:], S[:, own[-1] + 1 : end]], axis=1)
        Q = least_squares.orthonormal(others) if others.any() else np.zeros((len(S), 0))
        outside = S[:, own] - Q @ (Q.T @ S[:, own])
        M = outside.T @ outside / prior.dispersion
        spread = np.sqrt(np.maximum(np.diag(np.linalg.pinv(M)), 0.0)) * variables.scale[own]
        deviations[a.effect.name] = tuple(map(float, spread))
        change, whole = outside @ x[own], S[:, own] @ x[own]
        costs[a.effect.name] = float(change @ change)
        imitated[a.effect.name] = 1 - costs[a.effect.name] / max(float(whole @ whole), 1e-300)
    return Joint(
        equations.problem.cone @ w,
        additions,
        equations.active,
        loss,
        loss + prior.of(w, variables),
        len(r),
        len(w),
        deviations,
        costs,
        imitated,
        stop,
        out,
    )


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


def at_null(addition: Addition) -> Addition:
    """The effect with amplitudes at which it does nothing."""
    return replace(addition, amplitudes=tuple(p.null for p in addition.effect.amplitudes))
