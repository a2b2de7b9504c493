"""A wrong scale of the pictures."""

from __future__ import annotations

from dataclasses import dataclass

from calibrate.effects.effect import Effect, Parameter


@dataclass(frozen=True)
class Scale(Effect):
    """Lengths in the picture are wrong by one factor."""

    name = "DIC scale"
    stage = "measurement"
    of_rig = True
    formula = "x (1 + e)"
    amplitudes = (Parameter("e", "1", typical=0.02),)
    confounded_with = "a common factor of modulus, force, thickness and DIC scale"

    def loads(self, data, loads, a, shape):
        return loads * (1.0 + a[0])
