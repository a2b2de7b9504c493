"""The paper's claims beside our numbers (Friedrichs, Dammass, Kalina, Kaestner: Reliable training of neural hyperelastic
models via full-field data): what is claimed, what was found, the verdict. The limits of each claim are ours.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import Enum
from typing import Any

from studies.grid.axes import Loss
from studies.output.words import Words

CLAIM_COLUMNS = ("the paper", "loss", "data", "what we compare", "here", "verdict")
NOISES = {False: "clean", True: "noisy"}


class ClaimVerdict(Enum):
    """What our numbers say of a claim. OPEN: they cannot decide it."""

    CONFIRMED = "confirmed"
    REFUTED = "refuted"
    OPEN = "open"
    NOT_STUDIED = "not studied"

    @classmethod
    def of(cls, true: bool) -> ClaimVerdict:
        """Of a comparison that decides."""
        return cls.CONFIRMED if true else cls.REFUTED


class Statement(Enum):
    """A claim of the paper; value: the macro of ``templates/grid.txt`` that states it, its measure and what was found."""

    RELIABLE_INSIDE = "reliable_inside"
    UNIAXIAL_WORST_OUTSIDE = "uniaxial_worst_outside"
    LITTLE_INFLUENCE = "little_influence"
    LARGER_ERRORS = "larger_errors"
    SEVERE_DEFORMATION = "severe_deformation"


@dataclass(frozen=True)
class Claim:
    """A claim and what became of it. found: number by condition; limits: by which it is judged, by name.

    reference_bias: of the 2D reference, %, where that is why the claim stays open.
    """

    statement: Statement
    verdict: ClaimVerdict
    found: Mapping[str, float] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    loss: Loss | None = None
    noisy: bool = False
    reference_bias: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """For a file."""
        return {**asdict(self), "statement": self.statement.value, "verdict": self.verdict.value}


def claim_rows(claims: Sequence[Claim]) -> list[list[Any]]:
    """One row a claim; see `CLAIM_COLUMNS`."""
    words = Words("grid")
    rows: list[list[Any]] = []
    for claim in claims:
        name = claim.statement.value
        told = {part: getattr(words, f"{name}_{part}") for part in ("claim", "measure", "found")}
        found = told["found"](found=claim.found, limits=claim.limits) if claim.found else "–"
        verdict = words.verdict(verdict=claim.verdict.value, reference_bias=claim.reference_bias)
        measure = told["measure"](limits=claim.limits)
        loss = "–" if claim.loss is None else str(claim.loss)
        rows.append([told["claim"](), loss, NOISES[claim.noisy], measure, found, verdict])
    return rows
