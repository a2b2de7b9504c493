"""Stress of a base model of a single invariant, in JAX: spline coefficients and a deformation gradient in, P out."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from calibrate.equations.kinematics import invariants
from calibrate.equations.splines import DEGREE, polynomial_pieces


def base_law(k: int, n: int, top: Any, c: Any, f: Any) -> Any:
    """In-plane P (2, 2), MPa, at f (2, 2) of psi_k(J_k) with spline coefficients c (n,), as `SingleBasis` has it."""
    pieces = jnp.asarray(polynomial_pieces(n)[0])

    def energy_input(f):
        values = invariants(f)
        return values[0] - 3.0 if k == 0 else values[1] ** 1.5 - 3.0**1.5

    J, dJ = jax.value_and_grad(energy_input)(f)
    s = jnp.sqrt(jnp.clip(J / top, 1e-12, 1.0)) * (n - DEGREE)
    first = jnp.clip(jnp.floor(s).astype(int), 0, n - DEGREE - 1)
    t = s - first
    values = jnp.stack([jnp.ones_like(t), t, t * t, t * t * t]) @ pieces[first]
    return (values @ jax.lax.dynamic_slice(c, (first,), (DEGREE + 1,))) * dJ
