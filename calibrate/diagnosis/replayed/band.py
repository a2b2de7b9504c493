r"""The band of a replay: covariance of measured minus replayed, of a model that is right.

In: rows of the replayed base and final model at their levels, what parameters and alternatives change of them, and how far rows are beyond the fitted
range. Out: `Band`. Its parts:

- *noise* of the camera, in the fields and in the motion that is prescribed, and of the load cells;
- *parameters*: to first order Y C Y^T, with Y the change of the rows and C the covariance of base functions, amplitudes and shapes;
- *formula*: wrong by 2 % of what it explains, here of the difference between both replays, half of it of the same shape in all rows, half not;
- *discretisation*: of a replay on the camera's triangles;
- *alternatives*, averaged by evidence: sum_k p_k d_k d_k^T with d_k the difference of their replay to that of the final model, each at its own level;
- *extrapolation*: beyond the fitted strain or time by a share x of it, a model is wrong by x times what it leaves where it was fitted, and at
  least by x times the error of a formula; half of it in proportion to the force, half not.

The level is fitted to training forces, so that errors in common to these and to what is held out cancel (`Level.error_map`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.replayed.observations import Level, Observations
from calibrate.effects.effect import FORMULA_ERROR

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
FORCE_MESH, FIELD_MESH = 2e-4, 1.5e-4  # error of a replay: of a force; of a displacement (benchmarks/replay_mesh.py)
NOISE, PARAMETERS, FORMULA, MESH, ALTERNATIVES, BEYOND = (
    "noise",
    "parameters",
    "formula",
    "discretisation",
    "alternatives",
    "extrapolation",
)


@dataclass(frozen=True, eq=False)
class Alternative:
    """A competing explanation, replayed at its own level. share: of the probability, of those that were replayed."""

    names: tuple[str, ...]
    share: float
    rows: Observations = field(repr=False)


@dataclass(frozen=True, eq=False)
class Band:
    """parts: covariances (N, N) by their names. rivals: what each of the competing explanations adds to the variance (N,)."""

    parts: Mapping[str, Array] = field(repr=False)
    rivals: Mapping[tuple[str, ...], Array] = field(default_factory=dict, repr=False)

    @property
    def covariance(self) -> Array:
        """(N, N), of all together."""
        return np.sum(list(self.parts.values()), axis=0)

    @property
    def deviation(self) -> Array:
        """Standard deviation (N,) of measured minus replayed."""
        return np.sqrt(np.diag(self.covariance))

    def largest_part(self, where: Mask) -> tuple[str, tuple[str, ...]] | None:
        """What makes more than half of the variance of some rows (N,), and of competing explanations the one that makes most of it; None where no part does."""
        variances = {name: float(np.diag(V)[where].sum()) for name, V in self.parts.items()}
        name = max(variances, key=lambda one: variances[one])
        if not variances[name] > 0.5 * sum(variances.values()):
            return None
        most = max(self.rivals, key=lambda one: self.rivals[one][where].sum()) if name == ALTERNATIVES else ()
        return name, most


def errors_of_rows(final: Observations, base: Observations, spread: Array) -> dict[str, Array]:
    """Covariances (N, N) of the rows of the final model before its level is fitted. spread (N, q): Y times a root of C."""
    effect = final.residual - base.residual
    return {
        NOISE: final.noise,
        PARAMETERS: spread @ spread.T,
        FORMULA: FORMULA_ERROR**2 * _half_coherent(final, effect),
        MESH: discretisation(final),
    }


def band_of(
    final: Observations,
    base: Observations,
    level: Level,
    spread: Array,
    alternatives: Sequence[Alternative],
    beyond: Array,
) -> Band:
    """final, base: at their levels. beyond (N,): share by which a row is outside of what was fitted."""
    fitted = level.error_map(final)
    parts = {name: fitted @ V @ fitted.T for name, V in errors_of_rows(final, base, spread).items()}
    changes = [(one.share, final.residual - one.rows.residual) for one in alternatives]
    parts[ALTERNATIVES] = np.sum([p * np.outer(d, d) for p, d in changes], axis=0) + np.zeros_like(final.noise)
    parts[BEYOND] = _extrapolation(final, beyond)
    return Band(parts, {one.names: p * d**2 for one, (p, d) in zip(alternatives, changes, strict=True)})


def level_deviation(level: Level, final: Observations, base: Observations, spread: Array) -> float:
    """Of the level that the equilibrium gap and the replay should agree on, by all errors of the rows."""
    V = np.sum(list(errors_of_rows(final, base, spread).values()), axis=0)
    return float(np.sqrt(level.weights @ V @ level.weights))


def _half_coherent(rows: Observations, change: Array) -> Array:
    """Half of the variance of a change (N,) along it, half for every kind of row in itself, as large in all increments."""
    own = np.zeros(len(change))
    for test in np.unique(rows.test):
        for label in dict.fromkeys(rows.labels):
            same = (rows.test == test) & (np.array(rows.labels) == label)
            if same.any():
                own[same] = np.mean(change[same] ** 2)
    return 0.5 * np.outer(change, change) + 0.5 * np.diag(own)


def discretisation(rows: Observations) -> Array:
    """Covariance (N, N) of the errors of the mesh of a replay."""
    found = np.zeros(len(rows.test))
    for test in np.unique(rows.test):
        of_test = rows.test == test
        for increment in np.unique(rows.increment[of_test]):
            here = of_test & (rows.increment == increment)
            force, fields = here & rows.is_force, here & ~rows.is_force
            found[force] = FORCE_MESH * np.linalg.norm(rows.replayed[force])
            if fields.any():
                found[fields] = FIELD_MESH * np.linalg.norm(rows.measured[fields]) / np.sqrt(fields.sum())
    return np.diag(found**2)


def _extrapolation(rows: Observations, beyond: Array) -> Array:
    if not beyond.any():
        return np.zeros((len(beyond), len(beyond)))
    force, fitted = rows.is_force, ~rows.held
    change = np.where(force, _force_error(rows, force & fitted) * rows.replayed, _rms(rows.residual[~force & fitted]))
    change *= beyond
    sizes = change.copy()
    for test, increment in set(zip(rows.test.tolist(), rows.increment.tolist(), strict=True)):
        here = force & (rows.test == test) & (rows.increment == increment)
        sizes[here] = _rms(change[here])  # transverse forces as much as those along the pull
    return 0.5 * np.outer(change, change) + 0.5 * np.diag(sizes**2)


def _force_error(rows: Observations, fitted: Mask) -> float:
    """Relative, of what was fitted; at least that of a formula."""
    size = float(np.linalg.norm(rows.measured[fitted]))
    return max(FORMULA_ERROR, float(np.linalg.norm(rows.residual[fitted])) / size) if size > 0 else FORMULA_ERROR


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
