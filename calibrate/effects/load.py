"""What a load cell and its clock may get wrong: an offset, a lag, a gain; and a camera that is turned."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from calibrate.effects.effect import Effect, Parameter


@dataclass(frozen=True)
class ForceOffset(Effect):
    """Every measured force is too large by f0 in the direction that it has at the end."""

    name = "force offset"
    stage = "load"
    formula = "F - f0 F / |F|"
    amplitudes = (Parameter("f0", "N", typical=0.1),)
    decided_by = "a record that starts before the loading"

    def loads(self, data, loads, a, shape):
        last = loads[-1]
        size = jnp.sqrt(jnp.sum(last * last, axis=0))
        direction = last / jnp.where(size > 0, size, 1.0)
        return loads - a[0] * direction


@dataclass(frozen=True)
class Lag(Effect):
    """Forces were read dt after the image."""

    name = "lag between force and image"
    stage = "load"
    formula = "F(t) - dt dF/dt"
    amplitudes = (Parameter("dt", "s", typical=0.2),)
    decided_by = "a pause in the loading, or a second rate"

    def missing(self, data):
        if data.time is None:
            return "time"
        return None if len(data.time) > 2 else "more increments"

    def loads(self, data, loads, a, shape):
        rate = rate_matrix(data.time)
        return loads - a[0] * jnp.einsum("ts,siv->tiv", rate, loads)


@dataclass(frozen=True)
class ForceGain(Effect):
    """Every force is wrong by one factor."""

    name = "force gain"
    stage = "load"
    formula = "F (1 + g)"
    amplitudes = (Parameter("g", "1", typical=0.02),)
    gauge = "a common factor of modulus, force, thickness and DIC scale"

    def loads(self, data, loads, a, shape):
        return loads * (1.0 + a[0])


@dataclass(frozen=True)
class Rotation(Effect):
    """The camera is turned against the load axes by phi."""

    name = "image rotation"
    stage = "measurement"
    formula = "F turned by phi"
    amplitudes = (Parameter("phi", "rad", typical=0.02),)
    decided_by = "a picture of a plumb line"

    def loads(self, data, loads, a, shape):
        c, s = jnp.cos(a[0]), jnp.sin(a[0])
        return jnp.stack([c * loads[:, 0] - s * loads[:, 1], s * loads[:, 0] + c * loads[:, 1]], axis=1)


def rate_matrix(time):
    """(t, t): values to their time derivative, by parabolas through three neighbours."""
    n = len(time)
    D = jnp.zeros((n, n))
    for i in range(n):
        first = min(max(i - 1, 0), n - 3)
        j = np.arange(first, first + 3)
        powers = (time[j] - time[i])[None, :] ** np.arange(3)[:, None]
        D = D.at[i, j].set(jnp.linalg.solve(powers, jnp.array([0.0, 1.0, 0.0])))
    return D
