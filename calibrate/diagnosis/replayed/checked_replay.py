"""What the replay of a diagnosis came to, as plain data, computed elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.replayed.band import BEYOND, Band
from calibrate.diagnosis.replayed.observations import Level, Observations, ReplayErrors
from calibrate.diagnosis.replayed.replay_rule import LOAD_CELL, Judgement
from calibrate.models.parameter_covariance import Z95

Array = NDArray[np.float64]
DISAGREE = 2.576  # standard deviations of a level, from which equilibrium gap and replay disagree: once in a hundred


@dataclass(frozen=True, eq=False)
class Replayed:
    """A model at its level. rows: measured and replayed; deviation: of the level, by all errors of the rows."""

    level: Level
    deviation: float
    rows: Observations = field(repr=False)

    @property
    def fitted(self) -> ReplayErrors | None:
        """Errors of the increments that were fitted; None where there are none."""
        where = self.rows.may_judge(~self.rows.held)
        return ReplayErrors.of(self.rows, where) if where.any() else None

    @property
    def judged(self) -> ReplayErrors:
        """Errors of those held out; of all where nothing is; of tests that may judge."""
        return ReplayErrors.of(self.rows, self.rows.judged)

    @property
    def smooth(self) -> float:
        """Smooth part of the field error of those held out, mm; of all where nothing is."""
        return smooth_error(self.rows, self.rows.judged & ~self.rows.is_force, self.rows.residual**2)

    @property
    def levels_disagree(self) -> bool:
        """Whether the factor is further from 1 than its uncertainty and the error of a load cell explain."""
        return abs(self.level.factor - 1) > max(DISAGREE * self.deviation, LOAD_CELL)

    def to_dict(self) -> dict[str, Any]:
        """As discovery.json holds it."""
        return {
            "level": self.level.factor,
            "level_deviation": self.deviation,
            "fitted": None if self.fitted is None else self.fitted.to_dict(),
            "judged": self.judged.to_dict(),
        }


@dataclass(frozen=True, eq=False)
class ReplayCheck:
    """base, final: the same where nothing was added. without: alternatives that could not be replayed, and why. stand_ins: whether base and final model have no equilibrium
    themselves, and were replayed with the nearest base that does not soften; the level then is that of the stand-in."""

    base: Replayed
    final: Replayed
    band: Band = field(repr=False)
    judgement: Judgement
    alternatives: tuple[tuple[str, ...], ...] = ()
    without: tuple[str, ...] = ()
    stand_ins: tuple[bool, bool] = (False, False)

    @property
    def held_out(self) -> bool:
        """Whether the replay was judged by what was held out."""
        return bool(self.final.rows.held.any())

    @property
    def confirms(self) -> bool:
        """Whether something that was held out could have left the band, and did not."""
        judged = self.judgement.force is not None or self.judgement.field is not None
        return self.held_out and judged and not self.judgement.speaks_against

    @property
    def is_beyond(self) -> bool:
        """Whether part of what was judged is beyond the fitted range of strain or time."""
        return bool(np.diag(self.band.parts[BEYOND])[self.final.rows.judged].any())

    @property
    def expected(self) -> ReplayErrors:
        """Half of the 95 % band, as an error of all forces, relative, and of the smooth part of the fields, mm."""
        rows, variance = self.final.rows, np.diag(self.band.covariance)
        forces, fields = rows.judged & rows.is_force, rows.judged & ~rows.is_force
        size = float(np.linalg.norm(rows.measured[forces]))
        force = Z95 * float(np.sqrt(variance[forces].sum())) / size if size > 0 else float("nan")
        return ReplayErrors(force, Z95 * smooth_error(rows, fields, variance))

    @property
    def largest_part(self) -> tuple[str, tuple[str, ...]] | None:
        """Of the band of the forces, see `Band.largest_part`."""
        return self.band.largest_part(self.final.rows.judged & self.final.rows.is_force)

    @property
    def smooth(self) -> tuple[float, float]:
        """Smooth part of the field error before and after, mm."""
        return self.base.smooth, self.final.smooth

    def to_dict(self) -> dict[str, Any]:
        """As discovery.json and model.json hold it."""
        rows, variance = self.final.rows, np.diag(self.band.covariance)
        forces = rows.judged & rows.is_force
        parts = {name: float(np.sqrt(np.diag(V)[forces].sum() / max(variance[forces].sum(), 1e-300)))
                 for name, V in self.band.parts.items()}  # fmt: skip
        tests = {"force": self.judgement.force, "field": self.judgement.field}
        return {
            "held_out": self.held_out,
            "base": self.base.to_dict(),
            "final": self.final.to_dict(),
            "band": self.expected.to_dict(),
            "smooth_field": list(self.smooth),
            "share_of_force_band": parts,
            "largest_part_of_force_band": None if self.largest_part is None else dict(zip(("part", "effects"), self.largest_part, strict=True)),
            **{f"{name}_test": None if test is None else {"chi_square": test.value, "rows": test.degrees, "p": test.p_value}
               for name, test in tests.items()},
            "p": self.judgement.p_value,
            "outside": self.judgement.outside,
            "worse": self.judgement.worse,
            "beyond_range": self.is_beyond,
            "alternatives": [list(names) for names in self.alternatives],
            "without": list(self.without),
            "stand_ins": list(self.stand_ins),
        }  # fmt: skip


def smooth_error(rows: Observations, where: NDArray[np.bool_], squares: Array) -> float:
    """Root mean square over points, components and increments, mm, of rows of unit weight with these squares (N,)."""
    pairs = set(zip(rows.test[where].tolist(), rows.increment[where].tolist(), strict=True))
    values = sum(2 * int(rows.points[test]) for test, _ in pairs)
    return float(np.sqrt(squares[where].sum() / max(values, 1)))


@dataclass(frozen=True)
class NoReplayCheck:
    """Why a diagnosis was not replayed."""

    reason: str


def replay_record(check: ReplayCheck | NoReplayCheck | None) -> dict[str, Any] | None:
    """As files hold it; None where it was not asked for."""
    if isinstance(check, NoReplayCheck):
        return {"not_made": check.reason}
    return None if check is None else check.to_dict()
