"""A load cell whose gain grows, or falls, with the load."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter


@dataclass(frozen=True)
class LoadCellNonlinearity(Effect):
    """The largest force is read 1 + a times as large as it is, smaller ones in proportion less wrong."""

    name = "load cell nonlinearity"
    stage = "load"
    of_rig = True
    formula = "f / (1 + a |f| / f_max)"
    amplitudes = (Parameter("a", "1", lower=-0.5, upper=0.5, typical=0.02),)
    decided_by = "weights on the load cell"

    def missing(self, data):
        return None if len(data.u) > 2 else "more increments"

    def loads(self, data, loads, a, shape):
        size = jnp.sqrt(jnp.sum(loads * loads, axis=1, keepdims=True))
        largest = size.max(axis=0)
        return loads / (1.0 + a[0] * size / jnp.where(largest > 0, largest, 1.0))
