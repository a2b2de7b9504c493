"""Compressibility: a finite bulk modulus in plane stress.

With the energy psi(I1bar) + kappa (J - 1)^2 / 2 and sigma33 = 0 the sheet relaxes its volume ratio J. The isochoric part
of a sheet with in-plane F and volume ratio J is the incompressible sheet with J^(-1/3) F, hence

    P = J^(-1/3) P0(J^(-1/3) F),    J = 1 + beta p / J,    p = P0(Fbar) : Fbar / 3,    beta = 1 / kappa,

with P0 the stress of the incompressible sheet: exact, whatever psi. To first order psi falls by beta p^2 / 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter, lacks_plane_stress

ITERATIONS = 5


@dataclass(frozen=True)
class Compressibility(Effect):
    """P0 at F gives way to the stress at the relaxed volume."""

    name = "compressibility"
    stage = "kinematics"
    of_material = True
    formula = "psi(I1bar) + kappa (J - 1)^2 / 2, sigma33 = 0, beta = 1 / kappa"
    source = "Flory 1961; Simo, Taylor and Pister 1985"
    amplitudes = (Parameter("beta", "1/MPa", lower=0.0, typical=0.5),)
    decided_by = "the change of thickness, measured from the side"

    def missing(self, data):
        return lacks_plane_stress(data)

    def stress(self, data, F, P, a, shape, law):
        def change(f):
            J = jnp.ones(())
            for _ in range(ITERATIONS):
                relaxed = J ** (-1 / 3) * f
                J = 1.0 + a[0] * jnp.sum(law(relaxed) * relaxed) / (3.0 * J)
            return J ** (-1 / 3) * law(J ** (-1 / 3) * f) - law(f)

        return P + jnp.reshape(jax.vmap(change)(F.reshape(-1, 2, 2)), F.shape)
