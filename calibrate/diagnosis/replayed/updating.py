r"""Finite element model updating: what the equations leave open of a model is fitted to the forces of replays (Friswell and Mottershead 1995).

The equilibrium gap weighs equations by noise. Where a model is wrong by far more than noise, thousands of equations of the fields leave the forces no say: an effect that
hardly shows in the fields, as relaxation, is whatever helps the fields. So with e measured minus replayed forces of the increments that were fitted, V of the noise of the
camera, of the load cell as stated, and of one of class 0.5 (ISO 7500-1),

.. math:: e^T V^{-1} e + \sum_k (a_k - m_k)^2 / \lambda_k^2

is minimised over a factor on the base, amplitudes a and shapes. Both have m and lambda of the fit to the fields; amplitudes of effects with a memory their prior.
Nothing that is held out is used.

Between two replays the forces follow the law through the virtual fields of the last one, at its displacements: that is exact there, and not linear in the law.

In: replays, computed elsewhere. Out: `Updated`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from calibrate.diagnosis.parameters import Variables
from calibrate.diagnosis.replayed.checked_replay import ReplayCheck, Replayed
from calibrate.diagnosis.replayed.observations import Observations, ReplayErrors, level_of
from calibrate.diagnosis.replayed.parameter_spread import Directions, Spread, covariance_root
from calibrate.diagnosis.replayed.replay_rule import LOAD_CELL
from calibrate.diagnosis.replayed.replayed_rows import ReplayedRows, Replays
from calibrate.effects.chain import Additions
from calibrate.equations.noise_covariance import cholesky_factor
from calibrate.errors import FitError
from calibrate.fitting import gauss_newton
from calibrate.fitting.gauss_newton import Damping
from calibrate.fitting.least_squares import bounded

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Priors = Mapping[str, tuple[Array, Array]]  # mean and deviation of amplitudes (p,), or of shapes too (p + s,)
REPLAYS, STEPS, TRIED = 6, 10, 5  # at most; of a fit between two replays, and of one from other values
SMALL = 1.0  # change by one more fit, in standard deviations, at which the last replay is that of the model
TOLERANCE = 0.01  # fall of the objective in a step between two replays, in variances of what is left of a force
FACTOR = 2.0  # by which the base may change in a step
TRIALS = 3  # replays along a step


@dataclass(frozen=True, eq=False)
class Updated:
    """A model after it was updated: spread: its coefficients, effects and their covariance. before, after: errors of the increments that were fitted, each at its own level. converged: whether one more fit
    would change nothing that matters. forces: how many were fitted. check: its replay beside that of the base of the diagnosis, with band and what was held out."""

    spread: Spread
    before: ReplayErrors
    after: ReplayErrors
    converged: bool
    forces: int
    check: ReplayCheck | None = None

    @property
    def c(self) -> Array:
        """(n,), MPa."""
        return self.spread.directions.c

    @property
    def additions(self) -> Additions:
        """Effects, those at their null values with them."""
        return self.spread.directions.additions

    @property
    def deviations(self) -> tuple[tuple[float, ...], ...]:
        """Of every amplitude."""
        return tuple(own[: len(a.amplitudes)] for a, own in zip(self.additions, self._deviations, strict=True))

    @property
    def shape_deviations(self) -> tuple[tuple[float, ...], ...]:
        """Of every shape."""
        return tuple(own[len(a.amplitudes) :] for a, own in zip(self.additions, self._deviations, strict=True))

    @property
    def _deviations(self) -> tuple[tuple[float, ...], ...]:
        """Of amplitudes and shapes of each effect."""
        sizes = Variables(self.additions).sizes
        own = np.linalg.norm(self.spread.root, axis=1)[1:]
        return tuple(tuple(map(float, some)) for some in np.split(own, np.cumsum(sizes)[:-1])) if sizes else ()

    @property
    def replayed(self) -> Replayed | None:
        """At its level, with what was held out."""
        return None if self.check is None else self.check.final

    @property
    def present(self) -> tuple[Additions, tuple[tuple[float, ...], ...]]:
        """Effects that are not at their null values, and their deviations."""
        pairs = [(a, d) for a, d in zip(self.additions, self.deviations, strict=True) if not a.is_null]
        return tuple(a for a, _ in pairs), tuple(d for _, d in pairs)


@dataclass(frozen=True, eq=False)
class _Point:
    """Factor on the base, effects, and forces of unit variance with the prior on the amplitudes after them, r (m + a,)."""

    factor: float
    additions: Additions
    r: Array

    @property
    def objective(self) -> float:
        return float(self.r @ self.r) if np.isfinite(self.r).all() else np.inf

    @property
    def tolerance(self) -> float:
        """Fall of the objective that is none."""
        return TOLERANCE * max(1.0, self.objective / len(self.r))

    @property
    def values(self) -> Array:
        """Unknowns (1 + k,)."""
        return np.concatenate([[self.factor], Variables(self.additions).values])


@dataclass(frozen=True, eq=False)
class _Objective:
    """About a replay. c (n,): of the base at the factor 1; lower (m, m): of the covariance of forces. of_memory: whether the factor and effects with a memory alone are fitted."""

    replayed: ReplayedRows
    c: Array
    priors: Priors
    lower: Array
    of_memory: bool = False

    def at(self, factor: float, additions: Additions) -> _Point:
        """Another law, at the displacements of the replay."""
        return self.of(factor, additions, self.replayed.near(factor * self.c, additions))

    def of(self, factor: float, additions: Additions, e: Array) -> _Point:
        """A law whose measured minus replayed is e (N,)."""
        pulls = []
        for a in additions:
            mean, deviation = self.priors[a.effect.name]
            pulls.append((np.array([*a.amplitudes, *a.shape])[: len(mean)] - mean) / deviation)
        return _Point(factor, additions, np.concatenate([self._white(e), *pulls]))

    def slopes(self, point: _Point) -> Array:
        """Derivatives of `_Point.r` (m + a, 1 + k). Raises `FitError` where one of those of the forces is not finite."""
        directions = Directions.of(point.factor * self.c, point.additions, self.c[:, None], point.factor)
        used = _of_memory(point.additions) if self.of_memory else np.ones(len(directions.sizes), bool)
        rows = self._white(self.replayed.slopes(directions, used))
        if not np.isfinite(rows).all():
            names = " and ".join(a.effect.name for a in point.additions)
            raise FitError(
                f"the forces of a replay with {names} have no finite derivative, so that it cannot be updated by them"
            )
        known = [self.priors[a.effect.name][1] for a in point.additions]
        sizes = Variables(point.additions).sizes
        each = [np.eye(len(own), size) / own[:, None] for own, size in zip(known, sizes, strict=True)]
        pull = scipy.linalg.block_diag(np.zeros((0, 1)), *each)
        return np.concatenate([rows, pull]) * used

    def _white(self, rows: Array) -> Array:
        """Forces (m, ...) of unit variance, of all rows (N, ...); not finite where a trial is not."""
        forces = rows[_used(self.replayed.rows)]
        return np.asarray(scipy.linalg.solve_triangular(self.lower, forces, lower=True, check_finite=False))


@dataclass(frozen=True, eq=False)
class _Linearised:
    """The forces linearised about a point, see `gauss_newton.Linearised`."""

    objective: _Objective
    point: _Point
    slack: float = 0.0

    @cached_property
    def scale(self) -> Array:
        """Of the unknowns (1 + k,)."""
        return np.concatenate([[self.point.factor], Variables(self.point.additions).scale])

    @cached_property
    def J(self) -> Array:
        """By the unknowns over their scale."""
        return self.objective.slopes(self.point) * self.scale

    def solve(self, damping: float) -> Array:
        """Unknowns (1 + k,); what changes nothing stays."""
        J, now = self.J, self.point.values / self.scale
        size = np.linalg.norm(J, axis=0)
        moves = size > 1e-12 * size.max()
        A = np.concatenate([J, np.sqrt(damping) * np.diag(size)])[:, moves] / size[moves]
        target = np.concatenate([-self.point.r, np.zeros(len(size))])
        low, high = ((end / self.scale - now)[moves] * size[moves] for end in self._bounds())
        now[moves] += bounded(A, target, low, high) / size[moves]
        return now * self.scale

    def _bounds(self) -> tuple[Array, Array]:
        """Lower and upper (1 + k,)."""
        factor = self.point.factor
        low, high = Variables(self.point.additions).bounds(self.objective.replayed.tests)
        return np.concatenate([[factor / FACTOR], low]), np.concatenate([[factor * FACTOR], high])

    def moved(self, unknowns: Array, fraction: float) -> _Point:
        """Steps are damped, not cut."""
        return self.objective.at(float(unknowns[0]), Variables(self.point.additions).at(unknowns[1:]))

    def is_small(self, unknowns: Array, moved: _Point) -> bool:
        """Whether the objective hardly fell."""
        return self.point.objective - moved.objective < self.point.tolerance

    def is_minimum(self, unknowns: Array) -> bool:
        """Whether the step that was asked for promises no more."""
        after = self.point.r + self.J @ ((unknowns - self.point.values) / self.scale)
        return bool(self.point.objective - float(after @ after) < self.point.tolerance)


def update(
    replays: Replays, c: Array, additions: Additions, priors: Priors, others: Sequence[Additions] = (), of_memory: bool = False
) -> Updated | None:  # fmt: skip
    """From coefficients c (n,), which are changed by a factor, as those of neo-Hooke are, and effects. others: the same with other values, from which the first fit starts, too: of a time that the
    material remembers the misfit has several minima. of_memory: whether effects without a memory stay as they are. None where the start has no equilibrium. Raises `FitError` where no force is known."""
    replayed = replays(c, additions)
    if replayed is None:
        return None
    if not _used(replayed.rows).any():
        raise FitError("no force of an increment that was fitted is known, so that no model can be updated by forces")
    lower, before, factor, made = cholesky_factor(covariance(replayed.rows)), _errors(replayed), 1.0, 1
    while True:
        objective = _Objective(replayed, c, priors, lower, of_memory)
        start = objective.of(factor, additions, replayed.rows.residual)
        best = _best_time(objective, start, others) if made == 1 and others else start
        end = _fitted(objective, best)
        converged = bool(np.linalg.norm(end.r - start.r) < SMALL)
        moved = None if converged else _along(replays, objective, start, end, REPLAYS - made)
        if moved is None:
            break
        factor, additions, replayed, trials = moved
        made += trials
    directions = Directions.of(factor * c, additions, c[:, None], factor)
    J = np.concatenate([replace(objective, of_memory=False).slopes(start), _reach(additions)])
    spread = Spread(directions, covariance_root(J.T @ J))
    return Updated(spread, before, _errors(replayed), converged, int(_used(replayed.rows).sum()))


def _best_time(objective: _Objective, start: _Point, others: Sequence[Additions]) -> _Point:
    """Where the factor and effects with a memory are best, from the start and from the same with other values of them."""
    few = replace(objective, of_memory=True)
    starts = [start, *(few.at(start.factor, other) for other in others)]
    return min((_fitted(few, one, TRIED) for one in starts), key=lambda point: point.objective)


def _fitted(objective: _Objective, start: _Point, steps: int = STEPS) -> _Point:
    return gauss_newton.minimise(lambda point, _: _Linearised(objective, point), start, Damping(), steps).point


def _of_memory(additions: Additions) -> Mask:
    """(1 + k,): the factor, and the values of effects with a memory."""
    return np.array([True, *(a.effect.remembers for a in additions for _ in (*a.amplitudes, *a.shape))])


def _along(
    replays: Replays, objective: _Objective, start: _Point, end: _Point, most: int
) -> tuple[float, Additions, ReplayedRows, int] | None:
    """Factor, effects and their replay, the first on the way back from the end whose objective is below that of the start, and how many replays that took; None without one."""
    for k in range(min(TRIALS, most)):
        values = start.values + 0.5**k * (end.values - start.values)
        factor, additions = float(values[0]), Variables(start.additions).at(values[1:])
        replayed = replays(factor * objective.c, additions)
        if replayed is None:
            continue
        if objective.of(factor, additions, replayed.rows.residual).objective < start.objective:
            return factor, additions, replayed, k + 1
    return None


def _errors(replayed: ReplayedRows) -> ReplayErrors:
    """At its own level."""
    rows = replayed.rows.scaled(level_of(replayed.rows).factor)
    return ReplayErrors.of(rows, ~rows.held)


def _reach(additions: Additions) -> Array:
    """Rows (s, 1 + k) of the information on shapes that forces do not see."""
    variables = Variables(additions)
    rows = np.diag(np.concatenate([np.zeros(1), 1 / variables.shape_deviations]))[1:]
    return np.asarray(rows[variables.is_shape])


def covariance(rows: Observations) -> Array:
    """(m, m) of measured minus replayed forces."""
    used = _used(rows)
    return np.asarray(rows.noise[np.ix_(used, used)] + np.diag((LOAD_CELL * rows.measured[used]) ** 2))


def _used(rows: Observations) -> NDArray[np.bool_]:
    """Forces (N,) of increments that were fitted, of tests that may set the level."""
    return rows.may_judge(rows.is_force & ~rows.held)
