"""Permanent set: chains that are formed anew in the deformed state; seen in unloading only."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter
from calibrate.effects.support.largest_deformation import excess, lacks_unloading


@dataclass(frozen=True)
class PermanentSet(Effect):
    """Chains that break as x = I1 - 3 grows are formed anew, without stress, in the deformed state (Green and Tobolsky 1946).

    Those that break between two increments have the mean G of both deformations as their reference, P = law(F G^-1) G^-T,
    with the whole elastic law; fibres stay along the lines of the material that they were along.
    """

    name = "permanent set"
    stage = "set"
    of_material = True
    formula = "exp(-a x_max) P0 + sum w_j P0(F G_j^-1) G_j^-T, w_j: fall of exp(-a x_max), P0: of the energy"
    source = "Green and Tobolsky 1946"
    amplitudes = (Parameter("a", "1", lower=0.0, typical=0.05),)
    decided_by = "unloading to zero force, and a pause there"

    def missing(self, data):
        return lacks_unloading(data)

    def reformed(self, F, P, a, law):
        whole = jnp.exp(-a[0] * excess(F)[1])
        broken = -jnp.diff(whole, axis=0, prepend=1.0)
        before = jnp.concatenate([jnp.broadcast_to(jnp.eye(2), F[:1].shape), F[:-1]])
        formed = (before + F) / 2

        def stress(index, f):
            past = (jnp.arange(len(F)) <= index)[:, None]
            share = jnp.where(past, broken, 0.0)[..., None, None]
            return (share * law(jnp.broadcast_to(f, F.shape), formed)).sum(axis=0)

        return whole[..., None, None] * P + jax.lax.map(lambda both: stress(*both), (jnp.arange(len(F)), F))
