"""A load cell whose zero drifts."""

from __future__ import annotations

from dataclasses import dataclass

from calibrate.effects.effect import Effect, Parameter, lacks_turn
from calibrate.effects.force_offset import largest_direction


@dataclass(frozen=True)
class ForceDrift(Effect):
    """Every measured force is too large by d times the time since the reference, in the direction that it has where it is largest.

    Also of a record that was zeroed at the reference picture.
    """

    name = "force drift"
    stage = "load"
    of_rig = True
    formula = "f - d t e, e: direction of the largest force"
    amplitudes = (Parameter("d", "N/s", typical=0.1),)
    decided_by = "a record that goes on for the same time without a load"

    def missing(self, data):
        return lacks_turn(data)

    def loads(self, data, loads, a, shape):
        return loads - a[0] * data.time[:, None, None] * largest_direction(loads)
