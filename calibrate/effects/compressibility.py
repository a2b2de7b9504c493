"""Compressibility: the leading correction of plane stress for a finite bulk modulus.

With the pressure of the incompressible sheet, p = tr sigma / 3 (sigma33 = 0), the energy falls by p^2 / (2 kappa), which
is what relaxing det F = 1 against kappa (J - 1)^2 / 2 gives to first order in 1 / kappa.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter


@dataclass(frozen=True)
class Compressibility(Effect):
    """P loses d/dF of beta p^2 / 2, p = P : F / 3 and beta = 1 / kappa."""

    name = "compressibility"
    stage = "kinematics"
    of_material = True
    formula = "psi - beta p^2 / 2, p = tr sigma / 3, beta = 1 / kappa"
    amplitudes = (Parameter("beta", "1/MPa", lower=0.0, typical=0.5),)
    decided_by = "the change of thickness, measured from the side"

    def stress(self, data, F, P, a, shape, law):
        def relief(f):
            p = jnp.sum(law(f) * f) / 3.0
            return 0.5 * p * p

        slope = jax.vmap(jax.grad(relief))(F.reshape(-1, 2, 2))
        return P - a[0] * jnp.reshape(slope, F.shape)
