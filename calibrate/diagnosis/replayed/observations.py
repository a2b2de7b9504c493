"""What is compared of replayed tests: forces and smooth parts of the fields, as flat rows.

In: the replays of a model, computed elsewhere. Out: `Observations`, the level of the stiffness that their training forces ask for, and their errors.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from calibrate.equations.noise_covariance import cholesky_factor

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Observations:
    """N rows of all tests. test, increment (N,): which, from 0; held (N,): whether no equation of the increment was fitted; is_force (N,).

    measured, replayed (N,): a component of the force of a grip, N, or a mean of displacements with weights of unit norm, mm. noise (N, N): covariance
    of both differences by noise of the camera (of the motion that the replay prescribes, too) and of the load cells.
    labels: of every row, 'right x'. squares (tests, increments): mean square of measured minus replayed displacement over the points that are not
    prescribed, mm^2, NaN where not replayed; points (tests,): how many. judges (N,): rows that may judge the model and set its level, None for all: a test that has
    something for itself does not judge a replay that lacks it.
    """

    test: NDArray[np.int64]
    increment: NDArray[np.int64]
    held: Mask
    is_force: Mask
    measured: Array
    replayed: Array
    noise: Array = field(repr=False)
    labels: tuple[str, ...]
    squares: Array
    points: NDArray[np.int64]
    judges: Mask | None = None

    @property
    def judging(self) -> Mask:
        """Rows (N,) that may judge the model."""
        return np.ones(len(self.held), bool) if self.judges is None else self.judges

    @property
    def residual(self) -> Array:
        """Measured minus replayed (N,)."""
        return self.measured - self.replayed

    def scaled(self, factor: float) -> Observations:
        """Of the same model with a stiffness multiplied by a factor: displacements stay, forces grow."""
        return replace(self, replayed=np.where(self.is_force, factor * self.replayed, self.replayed))

    @cached_property
    def judged(self) -> Mask:
        """Rows (N,) that judge the model, of those that may: those held out; all where nothing is. Where none may, those that would."""
        return self.may_judge(self.held if self.held.any() else np.ones(len(self.held), bool))

    def may_judge(self, where: Mask) -> Mask:
        """Of rows (N,) those that may judge the model; all of them where none may."""
        own = where & self.judging
        return own if own.any() else where


@dataclass(frozen=True, eq=False)
class Level:
    """By which the stiffness is multiplied. deviation: by noise, times the root of the dispersion. weights (N,): of the measured rows, whose
    weighted sum the factor is."""

    factor: float
    deviation: float
    weights: Array = field(repr=False)

    def error_map(self, rows: Observations) -> Array:
        """(N, N): of errors of measured minus replayed, to those that are left once the level is fitted, which moves forces alone; rows at the level."""
        forces = np.where(rows.is_force, rows.replayed, 0.0) / self.factor
        return np.eye(len(forces)) - np.outer(forces, self.weights)


def level_of(rows: Observations) -> Level:
    """Weighted least squares of the forces that may judge, of the increments that were fitted, on the replayed ones (Aitken 1935); of unit factor where there are none.

    Nothing that is held out is used. Raises `FitError` for a covariance that is none. Forces are proportional to the stiffness where all that is prescribed are displacements.
    """
    used = rows.may_judge(rows.is_force & ~rows.held)
    none = np.zeros(len(used))
    if not used.any():
        return Level(1.0, 0.0, none)
    lower = cholesky_factor(rows.noise[np.ix_(used, used)])
    f, y = (scipy.linalg.solve_triangular(lower, values[used], lower=True) for values in (rows.replayed, rows.measured))
    information = float(f @ f)
    factor = float(f @ y) / information
    left = y - factor * f
    dispersion = max(1.0, float(left @ left) / max(1, len(y) - 1))
    weights = none.copy()
    weights[used] = scipy.linalg.solve_triangular(lower, f, lower=True, trans="T") / information
    return Level(factor, float(np.sqrt(dispersion / information)), weights)


@dataclass(frozen=True)
class ReplayErrors:
    """Of a replay. force: norm of the force errors over that of the measured forces, NaN where none is known; field: root mean square of measured
    minus replayed displacement of a component, mm, at points that are not prescribed: zero where all are."""

    force: float
    field: float

    @classmethod
    def of(cls, rows: Observations, where: Mask) -> ReplayErrors:
        """On some rows (N,)."""
        forces = where & rows.is_force
        size = np.linalg.norm(rows.measured[forces])
        force = float(np.linalg.norm(rows.residual[forces]) / size) if size > 0 else float("nan")
        pairs = sorted(set(zip(rows.test[where].tolist(), rows.increment[where].tolist(), strict=True)))
        squares = np.array([rows.squares[pair] for pair in pairs])
        weights = np.array([float(rows.points[i]) for i, _ in pairs])
        return cls(force, float(np.sqrt(weights @ squares / max(float(weights.sum()), 1.0))))

    def to_dict(self) -> dict[str, float | None]:
        """As files hold it."""
        return {"force": None if np.isnan(self.force) else self.force, "field": self.field}
