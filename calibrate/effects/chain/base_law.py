"""Stress of a base model of a single invariant, in JAX: spline coefficients and deformation gradients in, P out.

By components: with J = det F, tr = tr F^T F and C33 = 1 / J^2, the invariants of an incompressible sheet are I1 = tr + C33 and
I2 = J^2 + tr C33, and each of their derivatives is a multiple of F plus one of the cofactor of F.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from calibrate.equations.splines import DEGREE, polynomial_pieces
from calibrate.equations.tensors import Tensors


def base_law(k: int, n: int, top: Any, c: Any, F: Any) -> Any:
    """In-plane P (..., 2, 2), MPa, at F (..., 2, 2) of psi_k(J_k) with spline coefficients c (n,), as `SingleBasis` has it."""
    tensors = Tensors.of(F)
    J, trace = tensors.det, tensors.dot(tensors)
    C33 = 1.0 / (J * J)
    if k == 0:
        value, of_F, of_cofactor = trace + C33 - 3.0, 2.0, -2.0 * C33 / J
    else:
        second = J * J + trace * C33
        root = jnp.sqrt(second)
        value, of_F = second * root - 3.0**1.5, 3.0 * root * C33
        of_cofactor = 3.0 * root * (J - trace * C33 / J)
    psi = _spline(n, c, jnp.sqrt(jnp.clip(value / top, 1e-12, 1.0)))
    return (tensors * (psi * of_F) + tensors.cofactor * (psi * of_cofactor)).array


def _spline(n: int, c: Any, s: Any) -> Any:
    """The spline (...) with coefficients c (n,) at s (...), from 0 to 1: `Spline(n)`."""
    windows = jnp.stack([c[i : i + n - DEGREE] for i in range(DEGREE + 1)], axis=1)
    powers = jnp.einsum("ipk,ik->pi", jnp.asarray(polynomial_pieces(n)[0]), windows)
    place = s * (n - DEGREE)
    first = jnp.clip(jnp.floor(place).astype(int), 0, n - DEGREE - 1)
    t = place - first
    found = powers[DEGREE][first]
    for power in powers[DEGREE - 1 :: -1]:
        found = found * t + power[first]
    return found
