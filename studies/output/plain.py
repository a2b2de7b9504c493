"""Results that are kept as JSON: frozen dataclasses of plain numbers."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Self

from pydantic import TypeAdapter


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
    """A result of a step of a study. seconds: that it took."""

    seconds: float | None = field(default=None, kw_only=True)
