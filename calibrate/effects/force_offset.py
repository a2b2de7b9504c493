"""A load cell that was not zeroed."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter


@dataclass(frozen=True)
class ForceOffset(Effect):
    """Every measured force is too large by f0 in the direction that it has where it is largest."""

    name = "force offset"
    stage = "load"
    of_rig = True
    formula = "f - f0 e, e: direction of the largest force"
    amplitudes = (Parameter("f0", "N", typical=0.1),)
    decided_by = "a record that starts before the loading"
    measured_by = "forces count from that at the reference picture"

    def excluded(self, data):
        return data.zeroed

    def missing(self, data):
        return None if len(data.u) > 2 else "more increments"  # with one it could be the whole force

    def loads(self, data, loads, a, shape):
        if data.zeroed:  # beside another test that was not
            return loads
        return loads - a[0] * largest_direction(loads)


def largest_direction(loads):
    """Direction (2, b) of the largest of the forces (t, 2, b), N, on each of b boundaries."""
    size = jnp.sqrt(jnp.sum(loads * loads, axis=1))
    largest = jnp.take_along_axis(loads, jnp.argmax(size, axis=0)[None, None, :], axis=0)[0]
    return largest / jnp.where(size.max(axis=0) > 0, size.max(axis=0), 1.0)
