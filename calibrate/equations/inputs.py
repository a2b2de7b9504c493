"""Inputs of the energy: polyconvex invariants of the in-plane deformation gradient, and the strain they belong to.

J1 = I1 and J2 = I2^(3/2) of an incompressible sheet, from which an energy takes one or both (Hartmann and Neff 2003, IJSS 40).
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.equations import kinematics

Array = NDArray[np.float64]
INPUT_SETS = {"I1": (0,), "I2": (1,), "I1I2": (0, 1)}
REFERENCE = np.array([3.0, 3.0**1.5])


def polyconvex(F: Array) -> tuple[Array, Array]:
    """(J1, J2) - their rest values (..., 2) and dJ/dF (..., 2, 2, 2) of in-plane gradients F (..., 2, 2)."""
    values, derivatives = map(np.array, kinematics.invariants_and_derivatives(jnp.asarray(F)))
    derivatives[..., 1, :, :] *= (1.5 * np.sqrt(values[..., 1]))[..., None, None]
    values[..., 1] = values[..., 1] ** 1.5
    return values - REFERENCE, derivatives


def hencky_to_lode(F: Array) -> tuple[Array, Array]:
    """Norm (m,) and Lode angle (m,) in [-pi/6, pi/6] of the incompressible Hencky strain of F (m, 2, 2).

    sin(3 angle) = -3 sqrt(6) det(e): -pi/6 in uniaxial tension, 0 in pure shear, pi/6 in equi-biaxial tension.
    """
    C = np.einsum("mki,mkj->mij", F, F)
    mean, half = 0.5 * (C[:, 0, 0] + C[:, 1, 1]), 0.5 * (C[:, 0, 0] - C[:, 1, 1])
    radius = np.hypot(half, C[:, 0, 1])
    e1, e2 = 0.5 * np.log(mean + radius), 0.5 * np.log(np.maximum(mean - radius, 1e-300))
    e3 = -e1 - e2
    norm = np.sqrt(e1**2 + e2**2 + e3**2)
    ratio = -3 * np.sqrt(6) * e1 * e2 * e3 / np.maximum(norm, 1e-12) ** 3
    return norm, np.arcsin(np.clip(ratio, -1.0, 1.0)) / 3


def lode_to_hencky(norm: Array, angle: Array) -> Array:
    """Principal Hencky strains (m, 3), largest first, of norm (m,) and Lode angle (m,): inverse of the above."""
    shift = np.array([2 * np.pi / 3, 0.0, -2 * np.pi / 3])
    return np.sqrt(2.0 / 3.0) * norm[:, None] * np.sin(angle[:, None] + shift)
