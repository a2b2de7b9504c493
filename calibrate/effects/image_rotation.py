"""A camera that is turned against the load axes."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter


@dataclass(frozen=True)
class Rotation(Effect):
    """The camera is turned against the load axes by phi."""

    name = "image rotation"
    stage = "measurement"
    of_rig = True
    formula = "f turned by phi"
    amplitudes = (Parameter("phi", "rad", lower=-0.3, upper=0.3, typical=0.02),)
    decided_by = "a picture of a plumb line"

    def loads(self, data, loads, a, shape):
        c, s = jnp.cos(a[0]), jnp.sin(a[0])
        return jnp.stack([c * loads[:, 0] - s * loads[:, 1], s * loads[:, 0] + c * loads[:, 1]], axis=1)
