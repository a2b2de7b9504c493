"""What a load cell and its clock may get wrong: an offset, a lag, a gain; and a camera that is turned."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from calibrate.effects.effect import Effect, Parameter, lacks_rate


@dataclass(frozen=True)
class ForceOffset(Effect):
    """Every measured force is too large by f0 in the direction that it has where it is largest."""

    name = "force offset"
    stage = "load"
    formula = "f - f0 e, e: direction of the largest force"
    amplitudes = (Parameter("f0", "N", typical=0.1),)
    decided_by = "a record that starts before the loading"

    def missing(self, data):
        return None if len(data.u) > 2 else "more increments"  # with one it could be the whole force

    def loads(self, data, loads, a, shape):
        size = jnp.sqrt(jnp.sum(loads * loads, axis=1))
        largest = jnp.take_along_axis(loads, jnp.argmax(size, axis=0)[None, None, :], axis=0)[0]
        direction = largest / jnp.where(size.max(axis=0) > 0, size.max(axis=0), 1.0)
        return loads - a[0] * direction


@dataclass(frozen=True)
class Lag(Effect):
    """Forces were read dt after the picture, when the displacements were those of t + dt.

    Displacements are interpolated on the branch of the history that follows a picture if dt > 0, and on the one before if
    dt < 0. `branch` stands for the sign of dt where that is not known yet: 1, -1, or 0 for the mean of both. Forces, which
    are less smooth in time and may be held out, stay as they are.
    """

    name = "lag between force and image"
    stage = "load"
    formula = "u(t + dt)"
    amplitudes = (Parameter("dt", "s", typical=0.2),)
    shapes = (Parameter("branch", "1", lower=-1.0, upper=1.0),)
    shapes_vary = False
    decided_by = "a pause in the loading, or a second rate"

    def missing(self, data):
        return lacks_rate(data)

    def shape_values(self, data):
        if data.motion is None or np.allclose(data.motion[0], data.motion[1]):
            return [(0.0,)]
        return [(1.0,), (-1.0,), (0.0,)]

    def displacements(self, data, u, a, shape):
        after = jnp.where(a[0] > 0, 1.0, jnp.where(a[0] < 0, 0.0, 0.5 * (1.0 + shape[0])))
        rate, bend = after * data.motion[0] + (1.0 - after) * data.motion[1]
        return u + jnp.einsum("ts,sni->tni", a[0] * rate + a[0] ** 2 * bend, u)


@dataclass(frozen=True)
class ForceGain(Effect):
    """Every force is wrong by one factor."""

    name = "force gain"
    stage = "load"
    formula = "f (1 + g)"
    amplitudes = (Parameter("g", "1", typical=0.02),)
    gauge = "a common factor of modulus, force, thickness and DIC scale"

    def loads(self, data, loads, a, shape):
        return loads * (1.0 + a[0])


@dataclass(frozen=True)
class Rotation(Effect):
    """The camera is turned against the load axes by phi."""

    name = "image rotation"
    stage = "measurement"
    formula = "f turned by phi"
    amplitudes = (Parameter("phi", "rad", typical=0.02),)
    decided_by = "a picture of a plumb line"

    def loads(self, data, loads, a, shape):
        c, s = jnp.cos(a[0]), jnp.sin(a[0])
        return jnp.stack([c * loads[:, 0] - s * loads[:, 1], s * loads[:, 0] + c * loads[:, 1]], axis=1)
