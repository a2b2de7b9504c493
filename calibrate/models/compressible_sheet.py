r"""Homogeneous tests in plane stress of a network that has a bulk modulus: its faces, and in a uniaxial test its sides, are free.

In: a `Model` calibrated in plane strain, a mode, stretches. Out: `CompressibleSheet`. With the energy psi(f) + kappa (J - 1)^2 / 2, f = J^(-1/3) F,

    P = J^(-1/3) P0(f),    J (J - 1) = P0(f) : f / (3 kappa),

as in `calibrate.effects.compressibility`. Sides are free where f is a uniaxial test of constant volume. J is found by bisection: at J = 1 the
sheet has not changed its volume, at J = stretch^3 it has not changed its shape along the pull.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.equations import kinematics
from calibrate.equations.deformation_modes import stretches_to_gradient
from calibrate.errors import ConfigError
from calibrate.models.network_model import Model

Array = NDArray[np.float64]
HALVINGS = 60
STEP = 1e-4  # of a stretch, over which invariants and volume are differenced


@dataclass(frozen=True)
class CompressibleSheet:
    """volume_ratio J (k,); invariants (I1, I2) (k, 2) of the isochoric part f; stress (k,) along the pull, in the unit of the model."""

    volume_ratio: Array
    invariants: Array
    stress: Array


def compressible_sheet(model: Model, mode: str, stretch: Array) -> CompressibleSheet:
    """A homogeneous test at stretches (k,). Raises `ConfigError` for an unknown mode, and for a model without a bulk modulus."""
    if model.bulk_modulus is None:
        raise ConfigError("the model has no bulk modulus; draw its curves at constant volume: Model.homogeneous")
    x = np.asarray(stretch, dtype=np.float64)
    low, high = np.minimum(1.0, x**3), np.maximum(1.0, x**3)
    for _ in range(HALVINGS):
        J = 0.5 * (low + high)
        f, P0 = _isochoric(model, mode, x, J)
        grows = np.einsum("kij,kij->k", P0, f) / (3 * model.bulk_modulus) > J * (J - 1)
        low, high = np.where(grows, J, low), np.where(grows, high, J)
    invariants = np.asarray(kinematics.invariants_and_derivatives(jnp.asarray(f))[0])
    return CompressibleSheet(J, invariants, P0[:, 0, 0] / np.cbrt(J))


def sheet_stress(model: Model, mode: str, stretch: Array) -> Array:
    """Stress (k,) along the pull of a sheet with free faces, with the bulk modulus that the model has; at constant volume where it has none."""
    if model.bulk_modulus is None:
        return model.homogeneous(mode, stretch)
    return compressible_sheet(model, mode, stretch).stress


def compressible_deviation(model: Model, mode: str, stretch: Array) -> Array | None:
    """Standard deviation (k,) of the stress; None where no uncertainty is known.

    J and the free sides are those of least energy, so that a change of the energy changes the stress by its slope along the test,
    dP = (sum_k d psi / dI_k dI_k/dx + dkappa (J - 1) dJ/dx) / pulls, where an equi-biaxial test has two pulls that do work. Errors of network and bulk modulus count as independent.
    """
    x = np.asarray(stretch, dtype=np.float64)
    here, before, after = (compressible_sheet(model, mode, x + step) for step in (0.0, -STEP, STEP))
    width = 2 * STEP * (2 if mode == "equibiaxial" else 1)
    found = model.deviation(here.invariants, (after.invariants - before.invariants) / width)
    if found is None:
        return None
    by_bulk_modulus = (here.volume_ratio - 1) * (after.volume_ratio - before.volume_ratio) / width
    return np.hypot(found, by_bulk_modulus * (model.bulk_modulus_deviation or 0.0))


def _isochoric(model: Model, mode: str, x: Array, J: Array) -> tuple[Array, Array]:
    """f (k, 2, 2) at stretches (k,) and volume ratios (k,), and the stress P0 (k, 2, 2) of constant volume there."""
    shrunk = np.cbrt(J)
    if mode == "uniaxial":
        f = stretches_to_gradient(mode, x / shrunk)
    else:
        f = stretches_to_gradient(mode, x) / shrunk[:, None, None]
    return f, model.nominal_stress(f)
