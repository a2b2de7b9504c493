"""Base and many effects fitted at once; those that do not pay are taken out one at a time.

In: a `Problem` and candidates. Out: `Joint` fits: the whole, and what is left of it.

Where several effects disturb everything at like size, adding one at a time ends elsewhere for every order, because each takes
up what belongs to those that are still missing. So all come first. A weak normal prior of `PRIOR` typical amplitudes keeps
what the data hardly see from running away (ridge; Hoerl and Kennard 1970). Then the effect is taken out whose absence raises the
misfit least, until that costs more than the price of its parameters (Schwarz 1978), the misfit being counted in units of the
dispersion that the whole leaves (quasi-likelihood; Burnham and Anderson 2002).

The noise of the equations grows with the stiffness, so that a fit with fixed weights would pull it to zero. Here all stresses are
scaled by the factor s that makes internal and external work agree, s = f.f / g.f of the whitened work g and loads f, and
|s g - f|^2 is minimised by Levenberg's and Marquardt's method with exact derivatives. A step is judged after s has been made 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.diagnosis import effect_score, whitened
from calibrate.diagnosis.effect_fit import Variables
from calibrate.diagnosis.whitened import Problem
from calibrate.effects.chain import Addition, Additions
from calibrate.fitting import least_squares

Array = NDArray[np.float64]
PRIOR = 3.0  # typical amplitudes: standard deviation of the prior
STEPS = 100
CONVERGED = 0.02  # fall of the misfit in a step, over the dispersion
DAMPING, MOST_DAMPING = 1e-3, 1e6  # at first, and when a fit is given up
NOTHING = 1e-2  # dispersions: an effect that costs less is taken out without a look at others
TRIED = 2  # effects that are refitted without, before one is taken out


@dataclass(frozen=True, eq=False)
class Joint:
    """A fit. c (n,), MPa; additions: all candidates, those taken out at their null values; active: names of the others.

    loss: |g - f|^2 of n_rows equations by n_base functions of the base; objective: with the prior. deviations: a standard
    deviation of each amplitude, the prior included. costs: rise of the loss without each active effect, to first order. imitated:
    share of what each changes that the others could do. converged: False where `STEPS` steps were not enough. out: what was
    taken out last.
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
    converged: bool
    out: str | None = None

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
        """Misfit of an equation beyond what the parameters take up; 1 is noise."""
        return self.loss / max(self.n_rows - self.n_base - sum(map(n_parameters, self.present)), 1)

    def price(self, names: Sequence[str]) -> float:
        """log(n) for every parameter of some effects (Schwarz 1978)."""
        sizes = sum(n_parameters(a) for a in self.additions if a.effect.name in names)
        return sizes * float(np.log(self.n_rows))


def n_parameters(addition: Addition) -> int:
    """Number of amplitudes and shapes."""
    return len(addition.amplitudes) + len(addition.shape)


class _Equations:
    """Whitened equations with the stress scaled to the loads; effects that are not active, at their null values, take no part."""

    def __init__(self, problem: Problem, active: frozenset[str]) -> None:
        self.problem, self.active = problem, active
        self.chains = [part.chain for part in problem.trained]
        self.loads = whitened.loads(problem)
        self.columns = whitened.base_columns(problem, self.chains) @ problem.cone

    def residual(self, w: Array, additions: Additions) -> tuple[Array, float, Array]:
        """s g - f (N,), s and g (N,)."""
        g = whitened.residual(self.problem, self.problem.cone @ w, self.present(additions)) + self.loads
        product = float(g @ self.loads)
        if not product > 0:
            return np.full(len(g), np.inf), np.inf, g
        s = float(self.loads @ self.loads) / product
        return s * g - self.loads, s, g

    def present(self, additions: Additions) -> Additions:
        """Those that are active."""
        return tuple(a for a in additions if a.effect.name in self.active)

    def scaled(self, w: Array, additions: Additions) -> tuple[Array, Additions, tuple[Array, float, Array]]:
        """Both with stresses scaled to the loads, and the residual there; an effect on the loads makes it another one."""
        r, s, g = self.residual(w, additions)
        if not np.isfinite(s):
            return w, additions, (r, s, g)
        w, additions = s * w, _stiffer(additions, s)
        return w, additions, self.residual(w, additions)

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
            S[:, used] = self.problem.white([chain.jacobian(c, present) for chain in self.chains]).T
        return S


def candidates(scores: Sequence[effect_score.Score], nested: Sequence[str] = ()) -> Additions:
    """Tested effects at their null values, with the shapes that the score test found best; amplitudes that shapes need are
    started at a third of a typical one. nested: effects left out, because a more general one holds them."""
    result = []
    for one in scores:
        if one.status != "tested" or one.effect.name in nested:
            continue
        values = [
            float(np.clip(p.null + 0.3 * p.typical, p.lower, p.upper)) if one.effect.shapes else p.null
            for p in one.effect.amplitudes
        ]
        result.append(Addition(one.effect, tuple(values), one.shape))
    return tuple(result)


def fit(problem: Problem, c: Array, additions: Additions, active: frozenset[str], out: str | None = None) -> Joint:
    """Base, amplitudes and shapes of the active effects together. Raises `FitError` where the start is not finite."""
    equations, cone = _Equations(problem, active), problem.cone
    n = cone.shape[1]
    additions = tuple(a if a.effect.name in active else _nulled(a) for a in additions)
    w = np.maximum(np.linalg.lstsq(cone, c, rcond=None)[0], 0.0)
    w, additions, (r, s, g) = equations.scaled(w, additions)
    if not np.isfinite(r).all():
        raise errors.FitError("the joint fit has no finite start: check forces and their signs")
    damping, converged = DAMPING, False
    for _ in range(STEPS):
        variables = Variables(additions)
        prior = _Prior(variables, active, float(r @ r) / len(r), problem.prior)
        S = equations.slopes(w, additions, prior.used) * variables.scale
        bend = prior.bend(w, equations.shares(equations.columns, g), equations.shares(S, g))
        S, A = equations.projected(S, s, g), equations.projected(equations.columns, s, g)
        before, promised = float(r @ r) + prior.of(w, variables), None
        while damping < MOST_DAMPING:
            step = _step(A, S, bend, r, w, variables, prior, damping)
            promised = _fall(A, S, bend, r, w, variables, prior, step) if promised is None else promised
            moved = equations.scaled(step[:n], variables.at(step[n:] * variables.scale))
            after = float(moved[2][0] @ moved[2][0]) + prior.of(moved[0], Variables(moved[1]))
            if after < before:
                break
            damping = 10 * max(damping, 1e-4)
        if damping >= MOST_DAMPING:  # no step lowers the misfit: a minimum, if none promised to
            converged = promised is not None and promised < CONVERGED * prior.dispersion
            break
        w, additions, (r, s, g) = moved
        damping = max(damping / 5, 1e-8)
        if before - after < CONVERGED * prior.dispersion:
            converged = True
            break
    return _finished(equations, w, additions, active, converged, out)


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


def _step(
    A: Array, S: Array, bend: Array, r: Array, w: Array, variables: Variables, prior: _Prior, damping: float
) -> Array:
    """New weights of the base and values over their scale (n + k,), in bounds; what is not used stays."""
    scale, n, k = variables.scale, len(w), len(variables.values)
    lower, upper = (end / scale for end in variables.bounds)
    x = np.clip(variables.values / scale, lower, upper)
    moves = prior.used & S.any(axis=0)
    free = np.concatenate([np.full(n, n > 1), moves])  # a single base function has s alone
    J = np.concatenate([A, S], axis=1)
    pull = np.concatenate([np.zeros((k, n)), np.diag(prior.weights)], axis=1)
    damp = np.diag(np.sqrt(damping) * np.linalg.norm(J, axis=0))
    now, null = np.concatenate([w, x]), np.concatenate([w, prior.null / scale])
    rows = np.concatenate([J, bend, pull, damp])
    fixed = np.where(free, 0.0, now)
    target = np.concatenate([J @ now - r, bend @ now - prior.smooth @ w, pull @ null, damp @ now]) - rows @ fixed
    low, high = np.concatenate([np.zeros(n), lower]), np.concatenate([np.full(n, np.inf), upper])
    now[free] = least_squares.bounded(rows[:, free], target, low[free], high[free])
    return now


def _fall(
    A: Array, S: Array, bend: Array, r: Array, w: Array, variables: Variables, prior: _Prior, step: Array
) -> float:
    """By how much the objective falls in a step, if the equations were linear."""
    n = len(w)
    change = step - np.concatenate([w, variables.values / variables.scale])
    after = np.concatenate([r + A @ change[:n] + S @ change[n:], prior.smooth @ w + bend @ change])
    moved = variables.at(step[n:] * variables.scale)
    return float(r @ r - after @ after) + prior.of(w, variables) - prior.of_effects(Variables(moved))


def _finished(
    equations: _Equations, w: Array, additions: Additions, active: frozenset[str], converged: bool, out: str | None
) -> Joint:
    """The fit with the uncertainty of its amplitudes, and what each effect is worth."""
    r = equations.residual(w, additions)[0]
    variables = Variables(additions)
    loss = float(r @ r)
    prior = _Prior(variables, active, loss / len(r), equations.problem.prior)
    S = equations.compensated(equations.slopes(w, additions, prior.used) * variables.scale, w)
    S = np.concatenate([S, np.diag(prior.weights)])
    A = equations.compensated(equations.columns, w) if len(w) > 1 else np.zeros((len(r), 0))
    A = np.concatenate([A, np.zeros((len(variables.values), A.shape[1]))])
    deviations: dict[str, tuple[float, ...]] = {}
    costs, imitated = {}, {}
    x = (variables.values - prior.null) / variables.scale
    start = 0
    for a, size in zip(additions, variables.sizes, strict=True):
        own = np.arange(start, start + len(a.amplitudes))
        rest = np.delete(np.arange(S.shape[1]), np.arange(start, start + size))
        if a.effect.name in active:
            others = np.concatenate([A, S[:, rest], S[:, own[-1] + 1 : start + size]], axis=1)
            Q = least_squares.orthonormal(others) if others.any() else np.zeros((len(S), 0))
            left = S[:, own] - Q @ (Q.T @ S[:, own])
            M = left.T @ left / prior.dispersion
            spread = np.sqrt(np.maximum(np.diag(np.linalg.pinv(M)), 0.0)) * variables.scale[own]
            deviations[a.effect.name] = tuple(map(float, spread))
            change, whole = left @ x[own], (S[:, own] @ x[own])
            costs[a.effect.name] = float(change @ change)
            imitated[a.effect.name] = 1 - costs[a.effect.name] / max(float(whole @ whole), 1e-300)
        start += size
    objective = loss + prior.of(w, variables)
    c = equations.problem.cone @ w
    return Joint(c, additions, active, loss, objective, len(r), len(w), deviations, costs, imitated, converged, out)


def whole(problem: Problem, c: Array, additions: Additions, starts: int = 3, seed: int = 0) -> list[Joint]:
    """Fits with every candidate, the best first: from the null values, and from random ones of the typical size."""
    rng = np.random.default_rng(seed)
    active = frozenset(a.effect.name for a in additions)
    found = [fit(problem, c, additions, active)]
    for _ in range(starts - 1):
        moved = []
        for a in additions:
            values = (
                np.clip(v + p.typical * rng.normal(), p.lower, p.upper)
                for p, v in zip(a.effect.amplitudes, a.amplitudes, strict=True)
            )
            moved.append(replace(a, amplitudes=tuple(map(float, values))))
        found.append(fit(problem, c, tuple(moved), active))
    return sorted(found, key=lambda joint: joint.objective)


def reduced(problem: Problem, start: Joint, say: Callable[[str], None] = lambda text: None) -> list[Joint]:
    """The fits on the way from the whole to what pays, `start` first."""
    path, unit = [start], start.dispersion
    while path[-1].active:
        now = path[-1]
        net = {name: cost / unit - now.price([name]) for name, cost in now.costs.items()}
        likely = sorted(net, key=lambda name: net[name])
        does_nothing = now.costs[likely[0]] < NOTHING * unit
        tries = []
        for name in likely[: 1 if does_nothing else TRIED]:
            say(f"without {name}")
            tries.append(fit(problem, now.c, now.additions, now.active - {name}, name))
        best = min(tries, key=lambda joint: worth(now, joint, unit))
        if worth(now, best, unit) > 0:
            return path
        path.append(best)
    return path


def worth(before: Joint, after: Joint, unit: float) -> float:
    """What the smaller model `after` costs in misfit, in units of dispersion, less what it saves in parameters."""
    gone = before.active - after.active
    return (after.loss - before.loss) / unit - before.price(list(gone))


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


def _nulled(addition: Addition) -> Addition:
    return replace(addition, amplitudes=tuple(p.null for p in addition.effect.amplitudes))
