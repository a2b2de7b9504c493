"""Friction between the load cell and the sheet, as of the guides of a grip."""

from __future__ import annotations

from dataclasses import dataclass

from calibrate.effects.effect import Effect, Parameter
from calibrate.effects.force_offset import largest_direction


@dataclass(frozen=True)
class Friction(Effect):
    """Every load cell reads R more than the sheet has while the load grows, and R less while it falls (Coulomb); at rest as before."""

    name = "friction in the load train"
    stage = "load"
    of_rig = True
    formula = "f - R s e, s: sign of the motion of the grips, e: direction of the largest force"
    amplitudes = (Parameter("R", "N", lower=0.0, typical=0.1),)
    decided_by = "cycles without a specimen, or of a spring"

    def missing(self, data):
        return None if float(data.motion_sign.min()) < 0 else "a way back"

    def loads(self, data, loads, a, shape):
        return loads - a[0] * data.motion_sign[:, None, None] * largest_direction(loads)
