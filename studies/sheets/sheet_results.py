"""Results of the study on measured data, step by step: sheets, transfers, controls, homogeneous tests.

In: what `equigap discover` and `equigap transfer` left in their folders. Out: frozen dataclasses whose `to_dict` is what ``measured.json`` holds and
whose `from_dict` reads it, so that a stopped study goes on where it was.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

from calibrate.diagnosis.selection import Verdict
from studies.output.plain import Plain, StepResult
from studies.transfer.transferred import ForceAndField, Row, Transferred

NEO_HOOKE, BASE, FOUND, FEW = "neo-Hooke", "base", "base and effects found", "few effects"


@dataclass(frozen=True)
class ModelErrors(Plain):
    """Errors of a model in the increments that were fitted, and in those that were held out."""

    name: str
    fitted: ForceAndField
    held_out: ForceAndField


@dataclass(frozen=True)
class ReplayedErrors(Plain):
    """A model replayed from the motion of the grips. level: factor on its stiffness; errors of forces, relative, in the increments that were fitted and held out; field: mm, held out;
    band: half of the 95 % band of the force error; None of bases."""

    name: str
    level: float
    fitted: float | None
    held_out: float | None
    field: float
    band: float | None

    @classmethod
    def of(cls, found: Mapping[str, Any] | None, few: Mapping[str, Any] | None) -> list[Self]:
        """Of base and final model, of neo-Hooke and of few effects, from discovery.json; none where they were not replayed."""
        pairs: list[tuple[str, Mapping[str, Any], float | None]] = []
        if found is not None and "not_made" not in found:
            pairs += [(BASE, found["base"], None), (FOUND, found["final"], found["band"]["force"])]
        neo_hooke = (few or {}).get("neo_hooke")
        if neo_hooke is not None and "not_made" not in neo_hooke:
            pairs.append((NEO_HOOKE, neo_hooke, None))
        models = (few or {}).get("models") or [{}]
        replay = models[0].get("replay")
        pairs += [(FEW, replay["final"], replay["band"]["force"])] if replay else []
        return [
            cls(
                name,
                one["level"],
                one["fitted"] and one["fitted"]["force"],
                one["judged"]["force"],
                one["judged"]["field"],
                band,
            )
            for name, one, band in pairs
        ]


@dataclass(frozen=True)
class SheetResult(StepResult):
    """What `equigap discover` says of a sheet. few, probability: the most probable set of few effects, where nothing explains it; inclusion: probability of each;
    alerts: codes; answer: the verdict in words; replays: of every model that was replayed."""

    name: str
    verdict: Verdict
    named: list[str]
    closest: list[str]
    answer: str
    chi_square: float
    models: list[ModelErrors]
    few: list[str]
    probability: float | None
    inclusion: dict[str, float]
    alerts: list[str]
    replays: list[ReplayedErrors] = field(default_factory=list)

    @classmethod
    def of(cls, name: str, found: Mapping[str, Any]) -> Self:
        """From the content of discovery.json."""
        first, last, together = found["rounds"][0], found["rounds"][-1], found["few_effects"]
        models = [ModelErrors(BASE, _errors(first["train"]), _errors(first["held_out"]))]
        if last is not first:
            models.append(ModelErrors(FOUND, _errors(last["train"]), _errors(last["held_out"])))
        sets = (together or {}).get("sets") or [{"effects": [], "probability": None}]
        return cls(
            name=name,
            verdict=Verdict(found["verdict"]),
            named=list(found["named"]),
            closest=list(found["closest"]),
            answer=found["in_words"],
            chi_square=last["reduced_chi_square"],
            models=models,
            few=list(sets[0]["effects"]),
            probability=sets[0]["probability"],
            inclusion=dict((together or {}).get("inclusion", {})),
            alerts=sorted({one["code"] for one in found["alerts"]}),
            replays=ReplayedErrors.of(found["replay"], together),
        )

    def model(self, name: str) -> ModelErrors:
        """The model of that name; the base where there is none."""
        return next((one for one in self.models if one.name == name), self.models[0])


def _errors(content: Mapping[str, Any]) -> ForceAndField:
    """From an entry of discovery.json."""
    return ForceAndField(content["force_error"], content["field_error"])


@dataclass(frozen=True)
class TransferResult(StepResult):
    """What `equigap transfer` says of a sheet. answer: its findings; varies: whether its stiffness does."""

    name: str
    rows: list[Row]
    varies: bool
    answer: list[str]

    @classmethod
    def of(cls, found: Transferred, answer: list[str]) -> Self:
        """From what the command found."""
        return cls(found.experiment.name, list(found.rows), found.map.is_real, answer)

    def row(self, name: str) -> Row:
        """The variant of that name."""
        return next(row for row in self.rows if row.name == name)


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
class Amplitude(Plain):
    """An amplitude of an effect in a model. deviation: its standard deviation, None where it is not finite."""

    effect: str
    name: str
    unit: str
    value: float
    deviation: float | None


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
    """All results, sheets, transfers and controls by the name of the sheet."""

    sheets: dict[str, SheetResult]
    transfers: dict[str, TransferResult]
    controls: dict[str, ControlResult]
    loops: list[HomogeneousResult]

    def to_dict(self) -> dict[str, Any]:
        """Content of ``measured.json``: a result a step."""
        kinds: dict[str, Mapping[str, StepResult]] = {
            "sheet": self.sheets,
            "transfer": self.transfers,
            "control": self.controls,
            "loop": {one.name: one for one in self.loops},
        }
        return {f"{kind}_{name}": one.to_dict() for kind, found in kinds.items() for name, one in found.items()}
