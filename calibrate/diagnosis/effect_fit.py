"""Base and effects fitted together, with weights that follow both.

In: a `Problem`, effects, where to start. Out: `Fit`: coefficients, amplitudes with errors, and the chi-square tests of the residual.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.diagnosis import problem as equations
from calibrate.diagnosis import residual_tests
from calibrate.diagnosis.parameters import Variables, is_null
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.residual_tests import ChiSquare
from calibrate.diagnosis.signature_noise import denoised, of_rough_effects
from calibrate.effects.chain import Additions, Chain
from calibrate.fitting import gauss_newton
from calibrate.fitting.gauss_newton import Halving
from calibrate.fitting.least_squares import bounded, independent_errors, orthonormal, residual_outside
from calibrate.fitting.stopping import Stop

Array = NDArray[np.float64]
ITERATIONS = 6
FOLLOWED = 3  # iterations of a fit in which the estimate of the true displacements follows it
BEYOND = 1e100  # no quantity of a fit
BACK = 0.5  # of what a step has changed, by which the next one goes back
SMALL_STEP = 1e-2  # norm, in standard deviations of an equation, at which a fit ends


@dataclass(frozen=True, eq=False)
class Fit:
    """Base and effects fitted together.

    c (n,): spline coefficients. loss: |whitened residual|^2 of `n_rows` training equations. unexplained: of the part that
    neither the base (within its prior) nor the amplitudes could change. additions: effects; errors: a standard deviation for each
    amplitude, of noise and of what the kinematics may miss; null_covariances: (p, p) of the amplitudes of each effect at its own shapes, without what its own formula leaves, which is in proportion to it. columns (N, k): orthonormal, what the fit can adjust.
    residual (N,): whitened, rows of the prior last. log_determinant: of the covariance that the weights come from. last_step: norm of what the last step, had it been taken whole, would change, in standard deviations of an equation; above 1 the fit has not converged.
    """

    c: Array
    additions: Additions
    loss: float
    unexplained: ChiSquare
    n_rows: int
    columns: Array = field(repr=False)
    residual: Array = field(repr=False)
    chains: tuple[Chain, ...] = field(repr=False)
    log_determinant: float
    errors: tuple[tuple[float, ...], ...] = ()
    null_covariances: tuple[Array, ...] = field(default=(), repr=False)
    last_step: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """Of the effects."""
        return tuple(a.effect.name for a in self.additions)

    @property
    def deviations(self) -> tuple[tuple[float, ...], ...]:
        """Of each amplitude, of `errors` and the error of its formula."""
        return tuple(a.with_formula_error(own) for a, own in zip(self.additions, self.errors, strict=True))

    @property
    def distinct(self) -> Additions:
        """Effects that differ from none."""
        pairs = zip(self.additions, self.null_covariances, strict=True)
        return tuple(a for a, covariance in pairs if not is_null(a, covariance))

    def remembering(self) -> Fit:
        """The same with chains that keep what they make without effects, for many signatures, see `Chain.remembering`."""
        return replace(self, chains=tuple(chain.remembering() for chain in self.chains))

    @property
    def free_loss(self) -> float:
        """Chi-square of the part of the residual that neither base nor amplitudes could change."""
        return self.unexplained.value

    @property
    def degrees(self) -> int:
        """Degrees of freedom of `free_loss`."""
        return self.unexplained.degrees

    @property
    def converged(self) -> bool:
        """Whether the last step was one of no more than one standard deviation of an equation."""
        return self.last_step <= 1

    @property
    def reduced_chi_square(self) -> float:
        """Of what no I1 energy, convex or not, can absorb."""
        return self.free_loss / max(self.degrees, 1)


@dataclass(frozen=True, eq=False)
class _Point:
    """Weights w (n,) of the cone's columns and effects, with the whitened residual (N,)."""

    w: Array
    additions: Additions
    residual: Array

    @property
    def objective(self) -> float:
        """|residual|^2, that of the prior with it."""
        with np.errstate(over="ignore", invalid="ignore"):  # a step to what is not finite is halved
            return float(self.residual @ self.residual)


@dataclass(frozen=True, eq=False)
class _Linearised:
    """The fit linearised about a point, at displacements without the noise that shows in the residual.

    A (N, n): columns of the cone; base: the same, orthonormal. S (N, k): signatures over their scale (k,).
    outside (N, k): their part that the base cannot change, within its prior. Amplitudes and shapes are fitted to `outside`; the base then follows in its cone.
    taken (N,): what the step before has changed; of one that goes back by more than half of it, half is taken, or both would go on in turn.
    """

    problem: Problem
    point: _Point
    dispersion: float
    chains: tuple[Chain, ...]
    base: Array
    A: Array
    S: Array
    outside: Array
    variables: Variables
    scale: Array
    taken: Array

    @property
    def slack(self) -> float:
        """One for every unknown: signatures of noisy displacements are not the slope exactly."""
        return self.S.shape[1] + self.A.shape[1]

    @property
    def _start(self) -> tuple[Array, Array, Array]:
        """Values over their scale and their bounds (k,)."""
        if not self.variables.additions:
            return np.zeros(0), np.zeros(0), np.zeros(0)
        lower, upper = (end / self.scale for end in self.variables.bounds(self.problem.tests))
        return np.clip(self.variables.values / self.scale, lower, upper), lower, upper

    def solve(self, damping: float) -> Array:
        """Weights of the base and values over their scale (n + k,)."""
        w, r, n = self.point.w, self.point.residual, self.A.shape[1]
        x, lower, upper = self._start
        change = np.zeros(0)
        if len(x):
            target = self.outside @ x - (r - self.base @ (self.base.T @ r))
            change = bounded(self.outside, target, lower, upper) - x
            change[~self.S.any(axis=0)] = 0.0  # shapes that mean something at the null value only
        new = bounded(self.A, self.A @ w - r - self.S @ change, np.zeros(n), np.full(n, np.inf))
        return np.concatenate([new, x + change])

    def moved(self, unknowns: Array, fraction: float) -> _Point:
        """The point a fraction of the way to the unknowns (n + k,)."""
        w, n = self.point.w, self.A.shape[1]
        x = self._start[0]
        if self.change(unknowns[:n], unknowns[n:]) @ self.taken < -BACK * self.taken @ self.taken:
            fraction = 0.5 * fraction
        values = (x + fraction * (unknowns[n:] - x)) * self.scale
        additions = self.variables.at(values) if len(x) else ()
        return _point(self.problem, w + fraction * (unknowns[:n] - w), additions)

    def change(self, w: Array, x: Array) -> Array:
        """By how much the equations change (N,) to first order on the way to weights w (n,) and values x (k,) over their scale."""
        return np.asarray(self.A @ (w - self.point.w) + self.S @ (x - self._start[0]))

    def length(self, unknowns: Array) -> float:
        """By how much the step to the unknowns (n + k,) changes the equations, in standard deviations of one."""
        n = self.A.shape[1]
        base = np.linalg.norm(self.A @ (unknowns[:n] - self.point.w))
        return float((base + np.linalg.norm(self.S @ (unknowns[n:] - self._start[0]))) / np.sqrt(self.dispersion))

    def is_small(self, unknowns: Array, moved: _Point) -> bool:
        """Whether the whole step, even if it was halved, is shorter than `SMALL_STEP`."""
        return self.length(unknowns) < SMALL_STEP

    def is_minimum(self, unknowns: Array) -> bool:
        """Never asked for: the last halved step is taken anyway."""
        return False


def refit(problem: Problem, c: Array, additions: Additions) -> Fit:
    """Base, amplitudes and shapes together, by Gauss-Newton on the exact residual; c (n,): where it starts.

    Steps that raise the misfit are halved, those to what is not finite too. Raises `FitError` where a fit runs away.
    """
    w = np.maximum(np.linalg.lstsq(problem.cone, c, rcond=None)[0], 0.0)
    last: list[_Linearised] = []

    def linearise(point: _Point, count: int) -> _Linearised:
        known = last[-1] if last and not (count < FOLLOWED or any(a.effect.rough for a in problem.amplifying)) else None
        values = Variables(point.additions).values
        taken = last[-1].change(point.w, values / last[-1].scale) if last else np.zeros(len(point.residual))
        last[:] = [_linearised(problem, point, known, taken)]
        return last[0]

    try:
        found = gauss_newton.minimise(linearise, _point(problem, w, additions), Halving(), ITERATIONS)
        if found.reason is Stop.NOT_FINITE:
            raise _ran_away(additions)
        finished = _finished(problem, found.linear, found.point)
        return replace(finished, last_step=found.linear.length(found.step.unknowns))
    except np.linalg.LinAlgError:
        raise _ran_away(additions) from None


def _point(problem: Problem, w: Array, additions: Additions) -> _Point:
    return _Point(w, additions, equations.residual(problem, problem.cone @ w, additions))


def _linearised(problem: Problem, point: _Point, known: _Linearised | None, taken: Array) -> _Linearised:
    """known: where the estimate of the true displacements, and with it the columns of the base, are taken from. taken: see `_Linearised`."""
    c, r = problem.cone @ point.w, point.residual
    _check(r, point.additions)
    dispersion = equations.dispersion(problem, r)
    if known is None:
        chains = tuple(denoised(problem, c, point.additions, r, dispersion))
        A = equations.base_columns(problem, chains) @ problem.cone
        _check(A, point.additions)
        base = orthonormal(A)
    else:
        chains, base, A = known.chains, known.base, known.A
    variables, S = Variables(point.additions), np.zeros((len(r), 0))
    scale, outside = variables.scale, S
    if point.additions:
        S = equations.signatures(problem, chains, c, point.additions) * scale
        outside = S - base @ (base.T @ S)
        _check(outside, point.additions)
        if not outside.any():
            raise _ran_away(point.additions)
    return _Linearised(problem, point, dispersion, chains, base, A, S, outside, variables, scale, taken)


def _check(values: Array, additions: Additions) -> None:
    """Raises `FitError` where values are not finite, or their squares would not be."""
    if not np.abs(values).max(initial=0.0) < BEYOND:
        raise _ran_away(additions)


def _ran_away(additions: Additions) -> errors.FitError:
    names = " and ".join(a.effect.name for a in additions) or "no effect"
    return errors.FitError(f"the fit with {names} ran away; check forces and their signs, and the largest strains")


def _finished(problem: Problem, linear: _Linearised, point: _Point) -> Fit:
    """The fit at a point, its errors and tests from the problem linearised about the one before."""
    c, additions = problem.cone @ point.w, point.additions
    factor = 1 + (1 - 1 / linear.dispersion) * (equations.stiffness_factor(problem, c, additions) - 1)
    c, additions = factor * c, tuple(a.stiffer(factor) for a in additions)
    _check(c, additions)
    r = equations.residual(problem, c, additions)
    _check(r, additions)
    U = orthonormal(np.concatenate([linear.A, linear.S], axis=1))
    n_rows = len(r) - len(problem.prior)
    loss, left = float(r[:n_rows] @ r[:n_rows]), ChiSquare(*residual_outside(r, U))
    fit = Fit(c, additions, loss, left, n_rows, U, r, linear.chains, problem.log_determinant)
    return _with_errors(problem, linear, fit) if additions else fit


def _with_errors(problem: Problem, linear: _Linearised, fit: Fit) -> Fit:
    """With a standard deviation of each amplitude: of noise, times the dispersion, and of what the kinematics may miss; shapes are as uncertain as before the test at most (`Variables.shape_deviations`).

    Whether an effect differs from none is asked at its own shapes: of one that is none they are not defined (Davies 1977)."""
    variables, base = linear.variables, linear.base
    noise = np.sqrt(max(1.0, fit.free_loss / max(fit.degrees, 1)))
    known = np.diag(noise * linear.scale / variables.shape_deviations)
    columns = np.concatenate([linear.outside, known])
    of_noise = of_rough_effects(problem, linear.chains, fit.c, fit.additions, base, linear.scale, linear.S)

    def of(wrong: list[Array], held: slice) -> Array:
        """Covariance (k, k) of the variables but those that are held, of noise and of what is wrong."""
        free = np.delete(np.arange(len(known)), held)
        outside = [np.concatenate([one - base @ (base.T @ one), np.zeros(len(known))]) for one in wrong]
        found = np.zeros((len(columns) + len(wrong), len(known)))
        found[:, free] = independent_errors(columns[:, free], of_noise[np.ix_(free, free)], noise, outside)
        return np.asarray((found * linear.scale).T @ (found * linear.scale))

    given = problem, linear.chains, fit.c
    kinematic = residual_tests.kinematic_errors(*given, fit.additions)
    errors, null = np.sqrt(np.diag(of(kinematic, slice(0)))), []
    for i, (one, (own, shape)) in enumerate(zip(fit.additions, variables.slices, strict=True)):
        wrong = kinematic
        if one.effect.truncated:
            wrong = [kinematic[0], *residual_tests.formula_errors(*given, fit.additions[:i] + fit.additions[i + 1 :])]
        null.append(of(wrong, shape)[own, own])
    deviations = tuple(tuple(map(float, errors[own])) for own, _ in variables.slices)
    return replace(fit, errors=deviations, null_covariances=tuple(null))
