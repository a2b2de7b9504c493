"""What a polish did to a calibration: numbers before and after, and whether the polished model was kept."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from calibrate.models.network_model import Model

SHARES = (0.5, 1.0)  # of the calibrated range of stretch - 1, at which stresses are compared
AT_REST = np.array([3.0, 3.0])


class Kept(StrEnum):
    """Whether the polished model was kept, or why not."""

    POLISHED = "polished"
    NOT_CONVERGED = "not converged"
    NO_GAIN = "no gain"
    NO_EQUILIBRIUM = "no equilibrium"
    WORSE = "worse on held-out increments"


@dataclass(frozen=True)
class ReplayErrors:
    """Of a replay: chi-square of so many equations; relative force error; root mean square of the displacements that were not prescribed at the last
    increment, mm."""

    chi_square: float
    equations: int
    force_error: float
    field_error: float


@dataclass(frozen=True)
class PolishRecord:
    """before, after: on the fitted increments, held_before, held_after: on those held out, None where there are none. detail: of a failure.
    unpolished, model: before and after, the second None where the polish failed."""

    kept: Kept
    unpolished: Model
    model: Model | None = None
    iterations: int = 0
    before: ReplayErrors | None = None
    after: ReplayErrors | None = None
    held_before: ReplayErrors | None = None
    held_after: ReplayErrors | None = None
    detail: str = ""
    seconds: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """For a manifest and the model file."""
        names = ("before", "after", "held_before", "held_after")
        errors = {name: None if found is None else asdict(found) for name in names for found in [getattr(self, name)]}
        return {
            "kept": str(self.kept),
            "iterations": self.iterations,
            "detail": self.detail,
            "seconds": self.seconds,
            **errors,
        }

    def rows(self) -> list[list[Any]]:
        """Of `COLUMNS`: quantity, unit, before, after, change in standard deviations of the unpolished model."""
        found = _errors("", self.before, self.after) + _errors(
            ", held-out increments", self.held_before, self.held_after
        )
        return found if self.model is None else found + list(_stresses(self.unpolished, self.model))


COLUMNS = ("quantity", "unit", "before", "after", "change in standard deviations")


def _errors(where: str, before: ReplayErrors | None, after: ReplayErrors | None) -> list[list[Any]]:
    if before is None or after is None:
        return []
    pair = before, after
    return [
        [f"chi-square of the replay per equation{where}", "", *(e.chi_square / e.equations for e in pair), ""],
        [f"force error of the replay{where}", "%", *(100 * e.force_error for e in pair), ""],
        [f"field error of the replay at the last increment{where}", "mm", *(e.field_error for e in pair), ""],
    ]


def _stresses(before: Model, after: Model) -> list[list[Any]]:
    """Initial shear modulus and uniaxial stresses."""
    moduli = [float(2 * m.derivatives(AT_REST).sum()) for m in (before, after)]
    rows: list[list[Any]] = []
    deviation = before.deviation(AT_REST, np.array([2.0, 2.0]))
    rows.append(_row("initial shear modulus", before.unit, moduli, None if deviation is None else float(deviation)))
    stretch = 1 + (before.largest_stretch("uniaxial") - 1) * np.array(SHARES)
    deviations = before.homogeneous_deviation("uniaxial", stretch)
    for k, x in enumerate(stretch):
        pair = [float(m.homogeneous("uniaxial", stretch)[k]) for m in (before, after)]
        rows.append(
            _row(
                f"uniaxial stress at a stretch of {x:.3g}",
                before.unit,
                pair,
                None if deviations is None else float(deviations[k]),
            )
        )
    return rows


def _row(name: str, unit: str, pair: list[float], deviation: float | None) -> list[Any]:
    return [name, unit, *pair, "" if not deviation else (pair[1] - pair[0]) / deviation]
