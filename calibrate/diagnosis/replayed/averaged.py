"""Average of competing models by their probabilities (Bayesian model averaging: Hoeting, Madigan, Raftery and Volinsky 1999).

In: replays of the models, each at its own level. Out: what the average of their forces and smooth fields misses. Which of them is the most probable may hang on the last per cent; the average does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.replayed.checked_replay import ReplayCheck, smooth_error


@dataclass(frozen=True)
class Averaged:
    """fitted, judged: norm of the force errors over that of the measured forces, of increments that were fitted, and held out; NaN where none is known. smooth: root mean square of the smooth
    part of measured minus replayed displacement, mm, held out."""

    fitted: float
    judged: float
    smooth: float

    def to_dict(self) -> dict[str, float | None]:
        """As discovery.json holds it."""
        return {name: None if np.isnan(value) else value for name, value in asdict(self).items()}


def averaged(models: Sequence[tuple[float, ReplayCheck]]) -> Averaged | None:
    """Of probabilities and replays, which are of the same increments; None of fewer than two."""
    if len(models) < 2:
        return None
    whole = sum(probability for probability, _ in models)
    residual = np.sum([probability / whole * check.final.rows.residual for probability, check in models], axis=0)
    rows = models[0][1].final.rows
    fields = rows.judged & ~rows.is_force

    def force(where: NDArray[np.bool_]) -> float:
        size = float(np.linalg.norm(rows.measured[where & rows.is_force]))
        return float(np.linalg.norm(residual[where & rows.is_force])) / size if size > 0 else float("nan")

    return Averaged(force(rows.may_judge(~rows.held)), force(rows.judged), smooth_error(rows, fields, residual**2))
