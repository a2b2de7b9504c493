"""A clock of the load cell that differs from that of the camera."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from calibrate.effects.effect import Effect, Parameter, lacks_rate

LARGEST = 0.5  # of the duration of a test


@dataclass(frozen=True)
class Lag(Effect):
    """Forces were read dt after the picture, when the sections carried those of t + dt.

    What the sections carry is interpolated on the branch of the history that follows a picture if dt > 0, and on the one before if
    dt < 0. `branch` stands for the sign of dt where that is not known yet: 1, -1, or 0 for the mean of both. The forces at the pictures are those that
    give the readings so (`calibrate.effects.chain.readings`), so that a reading has a share in the equations of the pictures beside it.
    """

    name = "lag between force and image"
    stage = "clock"
    of_rig = True
    formula = "f(t + dt)"
    amplitudes = (Parameter("dt", "s", typical=0.2),)
    shapes = (Parameter("branch", "1", lower=-1.0, upper=1.0),)
    shapes_vary = False
    decided_by = "a pause in the loading, or a second rate"
    measured_by = "the crosshead moves when the grips in the pictures do"

    def excluded(self, data):
        return data.synchronised

    def missing(self, data):
        return lacks_rate(data)

    def limits(self, data):
        most = LARGEST * float(data.time[-1] - data.time[0])
        return np.array([-most]), np.array([most])

    def shape_values(self, data):
        if data.motion is None or np.allclose(data.motion[0], data.motion[1]):
            return [(0.0,)]
        return [(1.0,), (-1.0,), (0.0,)]

    def readings(self, data, a, shape):
        after = jnp.where(a[0] > 0, 1.0, jnp.where(a[0] < 0, 0.0, 0.5 * (1.0 + shape[0])))
        rate, bend = after * data.motion[0] + (1.0 - after) * data.motion[1]
        return jnp.eye(len(rate)) + a[0] * rate + a[0] ** 2 * bend
