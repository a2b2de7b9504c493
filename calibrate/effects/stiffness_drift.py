"""A material, or the gain of a load cell, that changes with time whatever the load does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrate.effects.effect import Effect, Parameter, lacks_turn

LARGEST = 5.0  # times as stiff, or as soft, at the end


@dataclass(frozen=True)
class StiffnessDrift(Effect):
    """All stresses, and with them all forces, grow by s in every second, as of a sheet that dries, cures, ages, or warms up.

    Displacements show nothing of it: a gain of the load cell that drifts is the same. Several tests have it alike.
    """

    name = "stiffness or gain drift"
    stage = "force"
    of_rig = True
    formula = "f / (1 + s t)"
    amplitudes = (Parameter("s", "1/s", typical=1e-3),)
    decided_by = "the same load again after the test, and a weight on the load cell"

    def missing(self, data):
        return lacks_turn(data)

    def limits(self, data):
        end = float(data.time[-1])
        return np.array([1 / LARGEST - 1.0]) / end, np.array([LARGEST - 1.0]) / end

    def loads(self, data, loads, a, shape):
        return loads / (1.0 + a[0] * data.time)[:, None, None]
