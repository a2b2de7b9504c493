r"""Plane strain of a compressible body: the energy of an incompressible sheet at its isochoric part, and a bulk modulus.

In: in-plane deformation gradients F (2, 2) with F33 = 1, J = det F, and the energy psi(I1bar, I2bar) + kappa (J - 1)^2 / 2.
The isochoric part J^(-1/3) diag(F, 1) has the in-plane part f = J^(-1/3) F, and its F33 is J^(-1/3) = 1 / det f, as that of an
incompressible sheet: every law P0(f) of plane stress is that of the isochoric energy, whatever the effects in it, and

    P = d/dF [psi(f(F)) + kappa (J - 1)^2 / 2]
      = J^(-1/3) (P0(f) - (P0(f) : F) / 3 F^-T) + kappa (J - 1) J F^-T

(the split of Flory 1961). Displacements fix the pressure through J - 1 only: with a bulk modulus of more than some tens
of shear moduli their noise hides it, and an incompressible solid cannot be identified in plane strain.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from calibrate.equations.tensors import Tensors, det


def isochoric(F: Any) -> Any:
    """f = J^(-1/3) F (..., 2, 2) of F (..., 2, 2): what invariants and laws of an incompressible sheet are taken of."""
    return F / jnp.cbrt(det(F))[..., None, None]  # finite also where simulated noise turns a triangle over


def stress(F: Any, isochoric_stress: Any, bulk_modulus: Any) -> Any:
    """P (..., 2, 2) of F (..., 2, 2), P0 (..., 2, 2) at f, and the bulk modulus; one unit of stress."""
    whole, part = Tensors.of(F), Tensors.of(isochoric_stress)
    J = whole.det
    inside = (part - whole.cofactor * (part.dot(whole) / (3 * J))) * (1 / jnp.cbrt(J))
    return (inside + whole.cofactor * (bulk_modulus * (J - 1.0))).array


def volumetric(F: Any) -> Any:
    """d/dF of (J - 1)^2 / 2, (..., 2, 2), at F (..., 2, 2)."""
    whole = Tensors.of(F)
    return (whole.cofactor * (whole.det - 1.0)).array
