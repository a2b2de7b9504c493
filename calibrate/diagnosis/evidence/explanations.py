"""What the evidence says: explanations with probabilities, and what a test shows of every effect. Plain data, computed elsewhere."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy import special

from calibrate.effects import Effect
from calibrate.effects.chain import Additions
from calibrate.effects.effect import Parameter

CERTAIN, TIE, UNKNOWN = (
    0.95,
    0.05,
    0.5,
)  # probability from which an effect is there, an explanation competes, and something in no catalogue is the more probable
RIVALS = 2  # competing explanations that are replayed beside the best


@dataclass(frozen=True, eq=False)
class Explanation:
    """Effects that together may explain a test. discrepancy: with something smooth that is in no catalogue beside them. additions, errors,
    c (n,) of the base: as they were fitted, none where they were not."""

    names: tuple[str, ...]
    log_evidence: float
    discrepancy: bool = False
    probability: float = 0.0
    additions: Additions = ()
    errors: tuple[tuple[float, ...], ...] = ()
    c: NDArray[np.float64] | None = field(default=None, repr=False)


@dataclass(frozen=True)
class Alternatives:
    """Explanations, the most probable first."""

    explanations: tuple[Explanation, ...]

    @classmethod
    def of(cls, found: Sequence[Explanation]) -> Alternatives:
        """With probabilities from log evidence."""
        weights = special.softmax([one.log_evidence for one in found])
        whole = [replace(one, probability=float(w)) for one, w in zip(found, weights, strict=True)]
        return cls(tuple(sorted(whole, key=lambda one: -one.log_evidence)))

    @property
    def inclusion(self) -> dict[str, float]:
        """Posterior probability of every effect: of all explanations that have it."""
        names = dict.fromkeys(name for one in self.explanations for name in one.names)
        return {name: sum(one.probability for one in self.explanations if name in one.names) for name in names}

    def together(self, group: Collection[str]) -> float:
        """Posterior probability of any of these effects."""
        return sum(one.probability for one in self.explanations if set(group) & set(one.names))

    @property
    def unexplained(self) -> float:
        """Posterior probability of something that is in no catalogue."""
        return sum(one.probability for one in self.explanations if one.discrepancy)


class Finding(StrEnum):
    """What a test shows of an effect; in model: too small or not probable enough to be named; open: significant, but not in the model; undecided: a limit beside a model that explains nothing is none."""

    FOUND = "found"
    IN_MODEL = "in the model, not named"
    OPEN = "significant, not in the model"
    EXCLUDED = "excluded above"
    INVISIBLE = "invisible in this test"
    UNDECIDED = "undecided, as nothing explains the test"
    MEASURED = "measured otherwise"
    OWN = "each test may have its own"


@dataclass(frozen=True)
class Power:
    """value: amplitude of what was found, with its standard deviation. limit: largest amplitude, by its distance from null, that these data allow; prior: its standard deviation before; both in the unit of
    `parameter`, None where nothing can be said. missing: what the data lack."""

    effect: Effect
    finding: Finding
    parameter: Parameter
    value: tuple[float, float] | None = None
    limit: float | None = None
    prior: float | None = None
    missing: tuple[str, ...] = ()

    @property
    def needed(self) -> str:
        """What would show it."""
        return ", ".join(self.missing) or self.effect.decided_by

    def stiffer(self, factor: float) -> Power:
        """In a material that is stiffer by a factor: amplitudes in MPa follow, those in 1/MPa go the other way."""
        own = factor**self.parameter.stiffness_power
        value = None if self.value is None else (own * self.value[0], own * self.value[1])
        limit, prior = (None if one is None else own * one for one in (self.limit, self.prior))
        return replace(self, value=value, limit=limit, prior=prior)

    @property
    def unnamed(self) -> Power:
        """Of an effect that is in the model and has no name."""
        return replace(self, finding=Finding.IN_MODEL) if self.finding is Finding.FOUND else self

    @property
    def beside_a_misfit(self) -> Power:
        """Of a model that explains nothing: what it excludes may be part of that, and what it has may stand in for it."""
        decided = self.finding in (Finding.EXCLUDED, Finding.FOUND)
        return replace(self, finding=Finding.UNDECIDED, limit=None) if decided else self


@dataclass(frozen=True, eq=False)
class Weighing:
    """alternatives; groups: effects that lie in the span of up to two others, by their names; powers: of every effect. fitted: whether the
    alternatives were fitted, or are linear in their amplitudes. significant: whether there is an effect; beside one that is not fitted, linear probabilities are none."""

    alternatives: Alternatives
    groups: dict[str, tuple[str, ...]]
    powers: tuple[Power, ...]
    fitted: bool
    significant: bool = True

    @property
    def inclusion(self) -> dict[str, float]:
        """Probability that each effect is there; nothing where explanations were not fitted, as linear probabilities are none."""
        return self.alternatives.inclusion if self.fitted else {}

    @property
    def is_provisional(self) -> bool:
        """Whether its probabilities order what is to be looked at, and no more: a strong effect is far from linear, and others make up for what its signature misses."""
        return self.significant and not self.fitted
