"""Viscoelasticity: one Prony branch on the second Piola-Kirchhoff stress (Simo 1987)."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from calibrate.effects.effect import Effect, Parameter, lacks_rate
from calibrate.equations.tensors import inverse

TIMES = 5


@dataclass(frozen=True)
class Viscosity(Effect):
    """S gains g int exp(-(t - s) / tau) dS/ds ds; stress is linear in time between increments and zero at t = 0."""

    name = "viscoelasticity"
    stage = "relaxation"
    of_material = True
    formula = "S + g int exp(-(t - s) / tau) dS"
    source = "Simo 1987"
    amplitudes = (Parameter("g", "1", lower=0.0, typical=0.2),)
    shapes = (Parameter("tau", "s", lower=0.0),)
    decided_by = "a pause in the loading, or a second rate"

    def missing(self, data):
        return lacks_rate(data)

    def shape_values(self, data):
        steps = np.diff(np.asarray(data.time), prepend=0.0)
        return [(float(t),) for t in np.geomspace(max(steps.min(), 1e-3 * data.time[-1]), data.time[-1], TIMES)]

    def stress(self, data, F, P, a, shape, law):
        tau = shape[0]
        S = inverse(F) @ P
        steps = jnp.diff(data.time, prepend=0.0)
        H, before, overstress = jnp.zeros_like(S[0]), jnp.zeros_like(S[0]), []
        for i, now in enumerate(S):
            ratio = steps[i] / tau
            some = jnp.where(ratio > 0, ratio, 1.0)
            gain = jnp.where(ratio > 0, -jnp.expm1(-some) / some, 1.0)  # at time 0 the load is there at once
            H = jnp.exp(-ratio) * H + gain * (now - before)
            overstress.append(H)
            before = now
        return P + a[0] * F @ jnp.stack(overstress)


@dataclass(frozen=True)
class SecondViscosity(Viscosity):
    """A second branch, for a material that relaxes over more than a decade of time; tested beside the first only."""

    name = "second relaxation time"
    source = "Simo 1987"
