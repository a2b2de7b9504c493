"""Viscoelasticity: one Prony branch on the isochoric second Piola-Kirchhoff stress in three dimensions (Simo 1987), condensed by P33 = 0."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

from calibrate.effects.effect import Effect, Parameter, lacks_rate
from calibrate.equations.tensors import Tensors

TIMES = 5
LONGEST = 10.0  # relaxation time, over the duration of the test


class Relaxation(Effect):
    """Base of the effects whose stress follows the strain in a time of their own, `tau`."""

    stage = "relaxation"
    of_material = True
    shapes = (Parameter("tau", "s", lower=0.0),)
    decided_by = "a pause in the loading, or a second rate"

    def missing(self, data):
        return lacks_rate(data)

    def is_told(self, data, shape):
        """Of a longer time a test sees a slope over time alone, however stiff the spring is."""
        return shape[0] < LONGEST * data.time[-1]

    def shape_values(self, data):
        steps = np.diff(np.asarray(data.time), prepend=0.0)
        return [(float(t),) for t in np.geomspace(max(steps.min(), 1e-3 * data.time[-1]), data.time[-1], TIMES)]


@dataclass(frozen=True)
class Viscosity(Relaxation):
    """S_iso gains Q = g int exp(-(t - s) / tau) dS_iso/ds ds; S_iso is linear in time between increments and zero at t = 0."""

    name = "viscoelasticity"
    formula = "S + Q - C33 Q33 C^-1, Q = g int exp(-(t - s) / tau) dS_iso (of a Prony series as in Abaqus: g / (1 + g))"
    source = "Simo 1987"
    amplitudes = (Parameter("g", "1", lower=0.0, typical=0.2),)

    def stress(self, data, F, P, a, shape):
        F, P = Tensors.of(F), Tensors.of(P)
        S, C = F.inverse @ P, F.T @ F
        trace, C33 = S.dot(C) / 3, 1 / C.det  # S33 = 0 holds for S, and S_iso : C = 0 in three dimensions
        whole = S - C.inverse * trace
        of_each = jnp.stack([whole.xx, whole.xy, whole.yx, whole.yy, -trace / C33], axis=-1)
        *Q, Q33 = jnp.moveaxis(convolved(of_each, data.time, shape[0]), -1, 0)
        return (P + F @ (Tensors(*Q) - C.inverse * (C33 * Q33)) * a[0]).array


def convolved(values: Any, time: Any, tau: Any) -> Any:
    """int exp(-(t - s) / tau) d values / ds ds of values (t, ...), linear in time (t,), s, and zero at time 0; tau in s."""
    ratio = jnp.diff(time, prepend=0.0) / tau
    some = jnp.where(ratio > 0, ratio, 1.0)
    gain = jnp.where(ratio > 0, -jnp.expm1(-some) / some, 1.0)  # at time 0 the load is there at once
    age = jnp.tril(time[:, None] - time)
    kernel = jnp.tril(jnp.exp(-age / tau)) * gain  # no recursion: unrolled, 119 increments take 10 GB to compile
    return jnp.tensordot(kernel, jnp.diff(values, axis=0, prepend=0.0), axes=1)


@dataclass(frozen=True)
class SecondViscosity(Viscosity):
    """A second branch beside the first, for a material that relaxes over more than a decade of time."""

    name = "second relaxation time"
    beside = Viscosity()
    decided_by = "a pause in the loading, or rates that differ by decades"
