"""Second invariant: psi + c01 (I2 - 3), the Mooney part of a rubber's energy (Rivlin 1948)."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter
from calibrate.equations.kinematics import invariants


@dataclass(frozen=True)
class SecondInvariant(Effect):
    """P gains c01 dI2/dF."""

    name = "second invariant"
    stage = "energy"
    of_material = True
    formula = "psi + c01 (I2 - 3)"
    source = "Mooney 1940; Rivlin 1948"
    amplitudes = (Parameter("c01", "MPa", lower=0.0, typical=0.03),)
    decided_by = "an equi-biaxial test beside a uniaxial one"

    def stress(self, data, F, P, a, shape):
        slope = jax.vmap(jax.grad(lambda f: invariants(f)[1]))(F.reshape(-1, 2, 2))
        return P + a[0] * jnp.reshape(slope, F.shape)
