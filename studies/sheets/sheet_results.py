"""Results on one measured sheet: models with their errors, what was learnt, what was transferred; kept as JSON.

In: plain numbers of `measured_loop` and `measured_transfer`. Out: frozen dataclasses whose `to_dict` is what
``measured.json`` holds and whose `from_dict` reads it, so that a stopped study goes on where it was. Models are found by
name, never by position.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any, Self

from pydantic import TypeAdapter

from calibrate.diagnosis.selection import Verdict
from calibrate.models.extended_model import ExtendedModel


class ModelName(StrEnum):
    """Models of a sheet that are transferred and shown; those on the way from one to the other have a name of their own."""

    BASE = "neo-Hooke"
    EVERY_EFFECT = "every effect"
    RETAINED = "retained by BIC"
    MEAN = "mean of the leave-one-out fits"


@dataclass(frozen=True)
class Plain:
    """A dataclass of plain numbers that can be kept as JSON."""

    def to_dict(self) -> dict[str, Any]:
        """Content for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Self:
        """From JSON. Raises `pydantic.ValidationError` (a ValueError) for content that is not complete."""
        return TypeAdapter(cls).validate_python(content)


@dataclass(frozen=True)
class StepResult(Plain):
    """A result of a step of the study. seconds: that it took."""

    seconds: float | None = field(default=None, kw_only=True)


@dataclass(frozen=True)
class ForceAndField(Plain):
    """Relative errors, see the top of `model_errors`."""

    force: float
    field: float

    def is_no_larger_than(self, other: ForceAndField) -> bool:
        """Whether neither error is larger than another's."""
        return self.force <= other.force and self.field <= other.field


@dataclass(frozen=True)
class ModelErrors(ForceAndField):
    """mean_force, section_scatter: root mean square of section over measured force minus 1, of the mean over the sections and
    of each; lower_over_upper: section force of the lower third over that of the upper third."""

    mean_force: float
    section_scatter: float
    lower_over_upper: float


@dataclass(frozen=True)
class ErrorsOfParts(Plain):
    """Errors in the increments that were fitted, and in those that were scored."""

    fitted: ModelErrors
    scored: ModelErrors


@dataclass(frozen=True)
class PartErrors(Plain):
    """The same of a model of which only these are shown."""

    force_fitted: float
    field_fitted: float
    force_scored: float
    field_scored: float


@dataclass(frozen=True)
class NamedModel(Plain):
    """A model, or several whose predictions are averaged. members: the content of their model files."""

    name: str
    members: list[dict[str, Any]]

    @property
    def models(self) -> tuple[ExtendedModel, ...]:
        """The model, or those whose mean it is."""
        return tuple(ExtendedModel.from_dict(one) for one in self.members)


@dataclass(frozen=True)
class Prediction(Plain):
    """What a model says of a sheet. grip_error (t, rows): residual over measured force; force (t,), N; sections (t, n): section
    force over measured force, bottom band first."""

    errors: ErrorsOfParts
    grip_error: list[list[float]]
    force: list[float]
    sections: list[list[float]]


@dataclass(frozen=True)
class ScoredModel(Prediction, NamedModel):
    """A model with its errors on a sheet."""


@dataclass(frozen=True)
class Shape(Plain):
    """A shape of an effect in a model."""

    effect: str
    name: str
    unit: str
    value: float


@dataclass(frozen=True)
class Amplitude(Shape):
    """An amplitude of an effect in a model. deviation: its standard deviation, None where it is not finite."""

    deviation: float | None

    @property
    def is_told_from_zero(self) -> bool:
        """Whether it is larger than two standard deviations."""
        return self.deviation is not None and abs(self.value) > 2 * self.deviation


@dataclass(frozen=True)
class FittedModel(ScoredModel):
    """A model learnt on a sheet; amplitudes and shapes are those of a single one."""

    base: str
    effects: list[str]
    chi_square: float
    reduced_chi_square: float
    amplitudes: list[Amplitude]
    shapes: list[Shape]


@dataclass(frozen=True)
class TransferredModel(ScoredModel):
    """A model learnt on another sheet. factor: on its stiffness; factors: that, and one on its relaxation where it was refitted."""

    factor: float
    factors: dict[str, float]

    @property
    def relaxation_was_refitted(self) -> bool:
        """Whether there are two factors."""
        return len(self.factors) > 1


@dataclass(frozen=True)
class Increments(Plain):
    """Numbers of the increments that are fitted, and that are scored."""

    fitted: list[int]
    scored: list[int]


@dataclass(frozen=True)
class Exchange(Plain):
    """An effect that replaced a more general one."""

    special: str
    general: str


@dataclass(frozen=True)
class Start(PartErrors):
    """A fit of every effect from one start. objective: over the dispersion."""

    objective: float


@dataclass(frozen=True)
class BaseResult(PartErrors):
    """The retained effects beside one base. penalised_misfit: minus that of the first base."""

    name: str
    penalised_misfit: float
    validation_error: ForceAndField
    chosen: bool


@dataclass(frozen=True)
class LeftOut(PartErrors):
    """What is retained without the increment at `left_out`, s."""

    left_out: float
    effects: list[str]


@dataclass(frozen=True)
class EffectWorth(PartErrors):
    """What an effect is worth: everything else fitted again without it. rise: of the misfit; penalty: of its parameters; imitated:
    share of its change that the others make; doubtful: nearly as likely without it."""

    effect: str
    rise: float
    penalty: float
    doubtful: bool
    imitated: float
    decided_by: str


def model_of[M: NamedModel](models: Sequence[M], name: str) -> M:
    """The model of that name."""
    return next(model for model in models if model.name == name)


@dataclass(frozen=True)
class SheetResult(StepResult):
    """What was learnt on a sheet. time (t,), s; spacing: of the virtual fields, mm; unfinished_fits: stopped before they had converged;
    predicts: no worse than the base; closest: effects, the most needed first; taken_out: in the order of their removal."""

    name: str
    spacing: float
    time: list[float]
    split: Increments
    not_testable: dict[str, str]
    dispersion: float
    equations: int
    exchanged: list[Exchange]
    models: list[FittedModel]
    starts: list[Start]
    bases: list[BaseResult]
    leave_one_out: list[LeftOut]
    unfinished_fits: int
    taken_out: list[str]
    predicts: bool
    verdict: Verdict
    without: list[EffectWorth]
    closest: list[str]

    def model(self, name: ModelName) -> FittedModel:
        """One of the models."""
        return model_of(self.models, name)

    @property
    def final(self) -> FittedModel:
        """The result: the mean of the leave-one-out fits."""
        return self.model(ModelName.MEAN)

    @property
    def named(self) -> list[FittedModel]:
        """The models that are transferred."""
        return [self.model(name) for name in ModelName]


@dataclass(frozen=True)
class TransferResult(StepResult):
    """Models of another sheet on this one. time (t,), s."""

    name: str
    time: list[float]
    models: list[TransferredModel]

    def model(self, name: ModelName) -> TransferredModel:
        """One of the models, its relaxation as learnt."""
        return model_of(self.models, name)

    @property
    def named(self) -> list[TransferredModel]:
        """The models with their relaxation as learnt."""
        return [one for one in self.models if not one.relaxation_was_refitted]

    @property
    def final(self) -> TransferredModel:
        """The result: the mean, where its relaxation was refitted that one."""
        refitted = (one for one in self.models if one.relaxation_was_refitted)
        return next(refitted, None) or self.model(ModelName.MEAN)
