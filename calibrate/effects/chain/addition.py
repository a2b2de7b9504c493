"""Effects that are in a model, with the values of their parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibrate.effects.effect import STAGES, Effect


@dataclass(frozen=True)
class Addition:
    """An effect that is in the model: amplitudes (p,) and the values of its shapes."""

    effect: Effect
    amplitudes: tuple[float, ...]
    shape: tuple[float, ...] = ()

    @property
    def is_null(self) -> bool:
        """Whether it changes nothing."""
        return self.amplitudes == tuple(p.null for p in self.effect.amplitudes)

    def with_formula_error(self, errors: tuple[float, ...]) -> tuple[float, ...]:
        """Deviations of the amplitudes (p,) from other errors and from that of the formula, a share of what it explains (`Effect.formula_error`)."""
        change = np.subtract(self.amplitudes, [p.null for p in self.effect.amplitudes])
        return tuple(map(float, np.hypot(errors, self.effect.formula_error * change)))

    def stiffness_factors(self, factor: float) -> tuple[float, ...]:
        """Of the amplitudes (p,) in a material that is stiffer by a factor: those in MPa follow, those in 1/MPa go the other way."""
        return tuple(factor**p.stiffness_power for p in self.effect.amplitudes)

    def stiffer(self, factor: float) -> Addition:
        """In a material that is stiffer by a factor."""
        pairs = zip(self.stiffness_factors(factor), self.amplitudes, strict=True)
        return replace(self, amplitudes=tuple(f * a for f, a in pairs))

    def nearer_null(self, share: float) -> Addition:
        """With this share of the way of every amplitude from its null value."""
        pairs = zip(self.effect.amplitudes, self.amplitudes, strict=True)
        return replace(self, amplitudes=tuple(p.null + share * (a - p.null) for p, a in pairs))


Additions = tuple[Addition, ...]


def ordered(additions: Additions) -> Additions:
    """From the material to the camera, the order in which effects act on the stress, and against which displacements and
    loads are corrected."""
    return tuple(sorted(additions, key=lambda a: (STAGES.index(a.effect.stage), a.effect.name)))


def place_of(addition: Addition, additions: Additions) -> int:
    """Place of an addition among all in their order."""
    return next(i for i, one in enumerate(ordered(additions)) if one is addition)
