"""Fitness for use of a model: the verdict of whoever fitted it, kept in its file, so that whatever reads the file can repeat it.

Key of a model file: optional ``fitness`` {"verdict": "usable" | "usable with reservations" | "do not use", "reasons": [sentences]}.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

SOFT = {"MPa": (1e-3, 200.0), "N/mm": (1e-4, 100.0)}  # initial shear moduli of what is soft enough for large strains


class Use(StrEnum):
    """Verdict on a model."""

    USABLE = "usable"
    RESERVATIONS = "usable with reservations"
    NOT = "do not use"


@dataclass(frozen=True)
class Fitness:
    """verdict, and the reasons against the use or for reservations, as a reader saw them."""

    verdict: Use
    reasons: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """For a model file."""
        return {"verdict": str(self.verdict), "reasons": list(self.reasons)}

    @classmethod
    def from_dict(cls, content: dict[str, Any] | None) -> Fitness | None:
        """Of a model file; None where it holds none. Raises KeyError, TypeError or ValueError."""
        if content is None:
            return None
        return cls(Use(content["verdict"]), tuple(map(str, content["reasons"])))
