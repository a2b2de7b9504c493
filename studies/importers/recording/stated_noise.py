"""Noise as far as a user states it; what is left open is estimated from the record.

In: standard deviations, None where they are not known. Out: a checked `StatedNoise`.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from calibrate import errors
from calibrate.data.experiment import Noise


@dataclass(frozen=True)
class StatedNoise:
    """displacement_std, mm, and its correlation_length, mm (None: uncorrelated); force_std, N, and force_std_relative, either or both.

    pattern_std, reference_std, mm: the parts that are common to all pictures, beside a displacement_std that is new in each, or drifts in a
    correlation_time, s (`Noise`).
    Where displacement_std is None, the noise of the displacements is estimated; where both of the force are, that of the force.
    Raises `ConfigError` for what is negative or not finite, and for what belongs to a standard deviation that is not stated.
    """

    displacement_std: float | None = None
    correlation_length: float | None = None
    force_std: float | None = None
    force_std_relative: float | None = None
    pattern_std: float | None = None
    reference_std: float | None = None
    correlation_time: float | None = None

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if value is not None and not (math.isfinite(value) and value >= 0):
                raise errors.ConfigError(f"noise: {name} = {value:g} must be a finite number, not negative")
        if self.displacement_std is None and self.correlation_length is not None:
            raise errors.ConfigError(
                "noise: correlation_length belongs to displacement_std; state both, or none, so that both are estimated"
            )

        if any(self.between_pictures) and not self.displacement_std:
            raise errors.ConfigError(
                "noise: pattern_std, reference_std and correlation_time belong to displacement_std, what is new in every picture; state it too"
            )

    @property
    def between_pictures(self) -> tuple[float, float, float]:
        """What is common to all pictures, mm, of the speckle pattern and of the reference picture, and the correlation time of the rest, s."""
        return self.pattern_std or 0.0, self.reference_std or 0.0, self.correlation_time or 0.0

    @property
    def of_displacements(self) -> tuple[float, float] | None:
        """Standard deviation and correlation length, mm; None: to be estimated."""
        return None if self.displacement_std is None else (self.displacement_std, self.correlation_length or 0.0)

    @property
    def of_forces(self) -> tuple[float, float] | None:
        """Relative standard deviation, and that in N; None: to be estimated."""
        if self.force_std is None and self.force_std_relative is None:
            return None
        return self.force_std_relative or 0.0, self.force_std or 0.0

    @classmethod
    def all_of(cls, noise: Noise) -> StatedNoise:
        """Every part of a Noise; nothing is estimated."""
        return cls(
            noise.displacement_std, noise.correlation_length, noise.force_std, noise.force_std_relative,
            noise.pattern_std, noise.reference_std, noise.correlation_time,
        )  # fmt: skip
