"""A camera that moves or warms up while the test goes on, which magnifies the picture."""

from __future__ import annotations

from dataclasses import dataclass

from calibrate.effects.effect import Effect, Parameter, lacks_turn
from calibrate.effects.out_of_plane import brought_back


@dataclass(frozen=True)
class MagnificationDrift(Effect):
    """The picture grows in proportion to time, by m until the end, whatever the load does."""

    name = "magnification drift"
    stage = "measurement"
    of_rig = True
    formula = "x (1 + m t / t_end)"
    source = "Ma, Pang and Ma 2012"
    amplitudes = (Parameter("m", "1", lower=-0.05, upper=0.05, typical=0.003),)
    decided_by = "pictures of the unloaded specimen over the same time"

    def excluded(self, data):
        return data.reference_height is not None  # two cameras measure it

    def missing(self, data):
        return lacks_turn(data)

    def displacements(self, data, u, a, shape):
        return brought_back(data, u, a[0] * data.time / data.time[-1])
