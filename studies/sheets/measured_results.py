"""Results of the study on measured data, beside those of one sheet: records, rivals, map, control, homogeneous tests, and all together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from calibrate.diagnosis.selection import Verdict
from studies.sheets.sheet_results import (
    Amplitude,
    ForceAndField,
    PartErrors,
    Plain,
    SheetResult,
    StepResult,
    TransferResult,
)


@dataclass(frozen=True)
class RecordResult(StepResult):
    """What a record says before any model. time (t,), s; force (t,), N; elongation (t,), mm; contraction: ratio of the logarithmic
    strains in the middle; axial, lateral (t, bands): strains; at_rest (2, bands): both at no load; missing_frames {frame: number}."""

    name: str
    time: list[float]
    force: list[float]
    elongation: list[float]
    force_exponent: float
    contraction: float
    bands_mm: list[float]
    axial: list[list[float]]
    lateral: list[list[float]]
    at_rest: list[list[float]]
    missing_frames: dict[str, int]
    noise: dict[str, Any]
    notes: list[str]


@dataclass(frozen=True)
class Rival(PartErrors):
    """The retained effects without relaxation, beside one base. misfit: over the dispersion."""

    name: str
    misfit: float


@dataclass(frozen=True)
class RivalResult(StepResult):
    """Softening with strain instead of relaxation in time."""

    models: list[Rival]


@dataclass(frozen=True)
class Change(Plain):
    """A number with the same stiffness everywhere, and with one that varies."""

    before: float
    after: float


@dataclass(frozen=True)
class ErrorChange(Plain):
    """Errors with the same stiffness everywhere, and with one that varies."""

    before: ForceAndField
    after: ForceAndField


@dataclass(frozen=True)
class ErrorChangeOfParts(Plain):
    """The same in the increments that were fitted, and in those that were scored."""

    fitted: ErrorChange
    scored: ErrorChange


@dataclass(frozen=True)
class MapResult(StepResult):
    """Stiffness over that of the transferred material. map (n,) at points (n, 2), mm, triangles (m, 3); cell: of its grid, mm;
    spacing: of the virtual fields, mm; weight: of its smoothness; left_out: residual of fields that are not fitted."""

    name: str
    cell: float
    spacing: float
    weight: float
    map: list[float]
    points: list[list[float]]
    triangles: list[list[int]]
    left_out: Change
    errors: ErrorChangeOfParts


@dataclass(frozen=True)
class EffectScore(Plain):
    """A score test where nothing may be found."""

    effect: str
    score: float
    degrees: int
    adjusted_p: float


@dataclass(frozen=True)
class ControlResult(StepResult):
    """Negative control on a sheet. pictures: compared; smallest_adjusted_p: 1 where nothing was tested."""

    name: str
    pictures: int
    reduced_chi_square: float
    smallest_adjusted_p: float
    effects: list[EffectScore]


@dataclass(frozen=True)
class HomogeneousErrors(Plain):
    """Relative errors of the force on a homogeneous test with the base, and with the model found."""

    name: str
    fitted: bool
    before: float
    after: float


@dataclass(frozen=True)
class CandidateResult(Plain):
    """A candidate of a round. why: it was not tested; numbers are None where it was not."""

    round: int
    effect: str
    status: str
    why: str
    score: float | None
    adjusted_p: float | None
    share: float | None
    admissible: bool


@dataclass(frozen=True)
class HomogeneousResult(StepResult):
    """The loop on homogeneous tests. groups {effect: effects that these data cannot tell from it}."""

    name: str
    question: str
    verdict: Verdict
    named: list[str]
    closest: list[str]
    groups: dict[str, list[str]]
    amplitudes: list[Amplitude]
    before_chi_square: float | None
    after_chi_square: float | None
    tests: list[HomogeneousErrors]
    candidates: list[CandidateResult]
    remarks: list[str]


@dataclass(frozen=True)
class MeasuredResults:
    """All results. records, controls {sheet: result}; first: learnt on it; second, hetero: transferred; own: learnt on the second alone."""

    records: dict[str, RecordResult]
    first: SheetResult
    rivals: RivalResult
    second: TransferResult
    own: SheetResult
    hetero: TransferResult
    map: MapResult
    controls: dict[str, ControlResult]
    loops: list[HomogeneousResult]

    @property
    def sheets(self) -> dict[str, SheetResult | TransferResult]:
        """Steps with models of a sheet, by name."""
        return {"first": self.first, "second": self.second, "own": self.own, "hetero": self.hetero}

    @property
    def learnt(self) -> dict[str, SheetResult]:
        """Steps that learn a model, by name."""
        return {"first": self.first, "own": self.own}

    def to_dict(self) -> dict[str, Any]:
        """Content of ``measured.json``: a result a step."""
        steps: dict[str, StepResult] = {
            **{f"record_{name}": one for name, one in self.records.items()},
            "first": self.first,
            "rivals": self.rivals,
            "second": self.second,
            "own": self.own,
            "hetero": self.hetero,
            "map": self.map,
            **{f"control_{name}": one for name, one in self.controls.items()},
            **{f"loop_{one.name}": one for one in self.loops},
        }
        return {name: one.to_dict() for name, one in steps.items()}
