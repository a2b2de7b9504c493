r"""Finite viscoelasticity: a neo-Hookean spring in series with a dashpot beside the equilibrium stress (Lubliner 1985; Reese and Govindjee 1998).

With the metric C_v of the dashpot, unimodular as C is,

.. math:: S \mathrel{+}= \mu (C_v^{-1} - C_{33} C_{v,33}^{-1} C^{-1}), \qquad \tau \dot C_v = C - \tfrac13 (C : C_v^{-1}) C_v .

At small strain it is the Prony branch of `viscosity` with g = mu over the modulus; at large strain the stress of the spring does not follow that of the base, and the spring is led back faster.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from calibrate.effects.effect import Parameter
from calibrate.effects.viscosity import Relaxation
from calibrate.equations.tensors import Tensors

STEPS = 4  # between two increments


@dataclass(frozen=True)
class FiniteViscosity(Relaxation):
    """P gains that of the spring; C is linear in time between increments, and the sheet at rest at time 0."""

    name = "finite viscoelasticity"
    has_spring = True
    formula = "S + mu (C_v^-1 - C33 C_v33^-1 C^-1), tau dC_v/dt = C - (C : C_v^-1) C_v / 3"
    source = "Lubliner 1985; Reese and Govindjee 1998"
    amplitudes = (Parameter("mu", "MPa", lower=0.0, typical=0.1),)

    def stress(self, data, F, P, a, shape):
        F = Tensors.of(F)
        C = F.T @ F
        C33 = 1 / C.det
        xx, xy, yy, zz = jnp.moveaxis(flowed(jnp.stack([C.xx, C.xy, C.yy, C33], axis=-1), data.time, shape[0]), -1, 0)
        spring = Tensors(yy, -xy, -xy, xx) * (1 / (xx * yy - xy * xy)) - C.inverse * (C33 / zz)
        return P + (F @ spring * a[0]).array


@dataclass(frozen=True)
class SecondFiniteViscosity(FiniteViscosity):
    """A second branch beside the first."""

    name = "second finite relaxation time"
    beside = FiniteViscosity()
    decided_by = "a pause in the loading, or rates that differ by decades"


def flowed(C: Any, time: Any, tau: Any) -> Any:
    """C_v (t, ..., 4), xx, xy, yy and zz, of C (t, ..., 4) at times (t,), s, both 1 at time 0; tau in s. Of second order in the step."""
    rest = jnp.broadcast_to(jnp.array([1.0, 0.0, 1.0, 1.0]), C.shape[1:])
    before = jnp.concatenate([rest[None], C[:-1]])

    def increment(past: Any, given: Any) -> Any:
        start, end, duration = given
        way = (end - start) / STEPS
        for k in range(STEPS):
            past = _step(past, start + k * way, start + (k + 1) * way, duration / (STEPS * tau))
        return past, past

    return jax.lax.scan(increment, rest, (before, C, jnp.diff(time, prepend=0.0)))[1]


def _step(past: Any, start: Any, end: Any, z: Any) -> Any:
    """C_v (..., 4) after z relaxation times, in which C goes from start to end (..., 4): exact of a rate C : C_v^-1 / 3 that stays, then unimodular."""
    xx, xy, yy, zz = jnp.moveaxis(past, -1, 0)
    C = jnp.moveaxis(0.5 * (start + end), -1, 0)
    rate = ((C[0] * yy + C[2] * xx - 2 * C[1] * xy) / (xx * yy - xy * xy) + C[3] / zz)[..., None] / 3
    x = rate * z
    some = jnp.where(x > 0, x, 1.0)
    decay, gain = jnp.exp(-x), jnp.where(x > 0, -jnp.expm1(-some) / some, 1.0)
    found = decay * past + (end - decay * start - gain * (end - start)) / rate
    volume = (found[..., 0] * found[..., 2] - found[..., 1] ** 2) * found[..., 3]
    return found / jnp.cbrt(volume)[..., None]
