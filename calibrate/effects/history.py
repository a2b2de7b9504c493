"""Softening and permanent set: what the largest deformation so far has left behind; seen in unloading only."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from calibrate.effects.effect import Effect, Parameter
from calibrate.effects.nodal_derivatives import law_gradients
from calibrate.equations.tensors import det, inverse

UNLOADED = 0.02  # share of the mean I1 - 3 by which the sheet must have come back


def excess(F):
    """I1 - 3 (t, m) and its largest value so far (t, m)."""
    value = jnp.sum(F * F, axis=(-2, -1)) + 1.0 / det(F) ** 2 - 3.0
    return value, jax.lax.cummax(value, axis=0)


def lacks_unloading(data) -> str | None:
    """What is missing for an effect that is seen where the sheet comes back from its largest deformation."""
    mean = np.asarray(excess(law_gradients(data, data.u))[0]).mean(axis=1)  # noise unloads single places in any test
    back = (np.maximum.accumulate(mean) - mean).max() > UNLOADED * mean.max()
    return None if back else "unloading"


@dataclass(frozen=True)
class Mullins(Effect):
    """P times 1 - r (1 - x / x_max), x = I1 - 3: softer the further below its largest deformation."""

    name = "Mullins softening"
    stage = "softening"
    of_material = True
    formula = "P (1 - r (1 - x / x_max)), x = I1 - 3"
    source = "Mullins 1969"
    amplitudes = (Parameter("r", "1", lower=0.0, upper=1.0, typical=0.2),)
    decided_by = "unloading and reloading"

    def missing(self, data):
        return lacks_unloading(data)

    def stress(self, data, F, P, a, shape, law):
        value, largest = excess(F)
        return P * (1.0 - a[0] * (1.0 - value / jnp.maximum(largest, 1e-9)))[..., None, None]


@dataclass(frozen=True)
class Payne(Effect):
    """P times 1 + r exp(-x_max / x0): stiffer where it was never much deformed."""

    name = "Payne softening"
    stage = "softening"
    of_material = True
    formula = "P (1 + r exp(-x_max / x0)), x = I1 - 3"
    source = "Payne 1962"
    amplitudes = (Parameter("r", "1", lower=0.0, typical=0.3),)
    shapes = (Parameter("x0", "1", lower=0.0),)
    decided_by = "cycles of small amplitude before and after a large one"

    def missing(self, data):
        return lacks_unloading(data)

    def shape_values(self, data):
        return [(0.02,), (0.1,), (0.5,)]

    def stress(self, data, F, P, a, shape, law):
        return P * (1.0 + a[0] * jnp.exp(-excess(F)[1] / shape[0]))[..., None, None]


@dataclass(frozen=True)
class PermanentSet(Effect):
    """Chains that break as x = I1 - 3 grows are formed anew, without stress, in the deformed state (Green and Tobolsky 1946).

    Those that break between two increments have the mean G of both deformations as their reference, P = law(F G^-1) G^-T,
    with the law of the base alone.
    """

    name = "permanent set"
    stage = "set"
    of_material = True
    formula = "exp(-a x_max) P + sum w_j P0(F G_j^-1) G_j^-T, w_j: fall of exp(-a x_max), P0: of the base"
    source = "Green and Tobolsky 1946"
    amplitudes = (Parameter("a", "1", lower=0.0, typical=0.05),)
    decided_by = "unloading to zero force, and a pause there"

    def missing(self, data):
        return lacks_unloading(data)

    def stress(self, data, F, P, a, shape, law):
        whole = jnp.exp(-a[0] * excess(F)[1])
        broken = -jnp.diff(whole, axis=0, prepend=1.0)
        before = jnp.concatenate([jnp.broadcast_to(jnp.eye(2), F[:1].shape), F[:-1]])
        back = inverse((before + F) / 2)

        def formed(f, share, g):
            return share * law(f @ g) @ g.T

        def stress(index, f):
            past = (jnp.arange(len(F)) <= index)[:, None]
            each = jax.vmap(jax.vmap(formed), (None, 0, 0))(f, jnp.where(past, broken, 0.0), back)
            return each.sum(axis=0)

        return whole[..., None, None] * P + jax.lax.map(lambda both: stress(*both), (jnp.arange(len(F)), F))
