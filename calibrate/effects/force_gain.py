"""A load cell with a wrong factor."""

from __future__ import annotations

from dataclasses import dataclass

from calibrate.effects.effect import Effect, Parameter


@dataclass(frozen=True)
class ForceGain(Effect):
    """Every force is read 1 + g times as large as it is."""

    name = "force gain"
    stage = "load"
    of_rig = True
    formula = "f / (1 + g)"
    amplitudes = (Parameter("g", "1", typical=0.02),)
    confounded_with = "a common factor of modulus, force, thickness and DIC scale"

    def loads(self, data, loads, a, shape):
        return loads / (1.0 + a[0])
