"""What a diagnosis leaves uncertain of its model: its parameters, its level, and explanations that compete with it. Plain data and its JSON.

Key ``uncertainty`` of a model file: ``root`` [n + k][q]: R of the covariance R R^T of the n coefficients of the base, then of amplitudes and shapes of every effect in its
order, in their units; ``level_deviation``: relative, of all stiffness; ``error``: relative, that a model of this test is wrong by where it was fitted; ``last_time``: s, or null;
``competitors`` [{"effects" [names], "kind", "probability", "coefficients" [n], "additions" as in the file}].
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.effects.chain import Addition, Additions
from calibrate.models.addition_json import addition_from_dict, addition_to_dict

Array = NDArray[np.float64]


class Kind(StrEnum):
    """Another explanation that was fitted; the model with an effect in another form; with an effect that the test does not show."""

    EXPLANATION = "explanation"
    FORM = "form"
    UNSEEN = "unseen"


@dataclass(frozen=True, eq=False)
class Competitor:
    """An explanation beside that of the model. c (n,): of its base; of what these data cannot tell: the model with an effect as large as its root mean square, and the base that
    makes up for it."""

    probability: float
    c: Array = field(repr=False)
    additions: Additions
    kind: Kind = Kind.EXPLANATION

    @property
    def names(self) -> tuple[str, ...]:
        """Of its effects."""
        return tuple(a.effect.name for a in self.additions)

    def scaled(self, factor: float, strength: float = 1.0) -> Competitor:
        """Stiffer by a factor."""
        additions = tuple(scaled_addition(a, factor, strength) for a in self.additions)
        return replace(self, c=factor * self.c, additions=additions)


@dataclass(frozen=True, eq=False)
class ModelUncertainty:
    """root (n + k, q), see the module; level_deviation, error: relative; last_time: of what was fitted, s."""

    root: Array = field(repr=False)
    competitors: tuple[Competitor, ...] = ()
    level_deviation: float = 0.0
    error: float = 0.0
    last_time: float | None = None

    def scaled(self, factor: float, additions: Additions, strength: float = 1.0) -> ModelUncertainty:
        """Of a model that is stiffer by a factor, with these additions."""
        each = [
            f for a in additions for f in (*stiffness_factors(a, factor, strength), *(1.0 for _ in a.effect.shapes))
        ]
        n = len(self.root) - len(each)
        root = np.concatenate([np.full(n, factor), each])[:, None] * self.root
        return replace(self, root=root, competitors=tuple(one.scaled(factor, strength) for one in self.competitors))

    def to_dict(self, unit: str) -> dict[str, Any]:
        """Of a model file; unit: of its stresses."""
        return {
            "root": self.root.tolist(),
            "level_deviation": self.level_deviation,
            "error": self.error,
            "last_time": self.last_time,
            "competitors": [
                {
                    "effects": list(one.names),
                    "kind": str(one.kind),
                    "probability": one.probability,
                    "coefficients": one.c.tolist(),
                    "additions": [addition_to_dict(a, (0.0,) * len(a.amplitudes), unit) for a in one.additions],
                }
                for one in self.competitors
            ],
        }

    @classmethod
    def from_dict(cls, content: dict[str, Any], n: int, additions: Additions) -> ModelUncertainty:
        """Of a model file with n coefficients and additions. Raises KeyError, TypeError, ValueError."""
        rows = n + sum(len(a.amplitudes) + len(a.shape) for a in additions)
        root = np.asarray(content["root"], float)
        if root.ndim != 2 or len(root) != rows:
            raise ValueError(
                f"uncertainty: root needs {rows} rows, of {n} coefficients and the parameters of the effects, it has the shape {root.shape}"
            )
        competitors = tuple(_competitor(one, n) for one in content["competitors"])
        found = float(content["level_deviation"]), float(content["error"])
        if not (np.isfinite(root).all() and np.isfinite(found).all() and min(found) >= 0):
            raise ValueError(
                "uncertainty: root, level_deviation and error must be finite numbers, the latter not negative"
            )
        last = content["last_time"]
        if last is not None and not float(last) > 0:
            raise ValueError(f"uncertainty: last_time {last} is not a positive number")
        return cls(root, competitors, *found, None if last is None else float(last))


def _competitor(content: dict[str, Any], n: int) -> Competitor:
    c, probability = np.asarray(content["coefficients"], float), float(content["probability"])
    if c.shape != (n,) or not np.isfinite(c).all() or not 0 <= probability <= 1:
        raise ValueError(f"uncertainty: a competitor needs {n} finite coefficients and a probability of 0 to 1")
    return Competitor(
        probability, c, tuple(addition_from_dict(a)[0] for a in content["additions"]), Kind(content["kind"])
    )


def stiffness_factors(addition: Addition, factor: float, strength: float = 1.0) -> tuple[float, ...]:
    """Of the amplitudes (p,) of an effect in a material that is stiffer by a factor: amplitudes in MPa follow, those in 1/MPa go the other way; relaxation by its own `strength`."""
    own = strength if addition.effect.stage == "relaxation" else 1.0
    return tuple(own * f for f in addition.stiffness_factors(factor))


def scaled_addition(addition: Addition, factor: float, strength: float = 1.0) -> Addition:
    """The effect in a material that is stiffer by a factor."""
    pairs = zip(stiffness_factors(addition, factor, strength), addition.amplitudes, strict=True)
    return replace(addition, amplitudes=tuple(f * a for f, a in pairs))
