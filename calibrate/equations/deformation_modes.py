"""The three homogeneous modes of incompressible rubber: uniaxial, equi-biaxial and pure shear.

In: a mode by name and stretches along the pull. Out: in-plane deformation gradients, invariants, nominal stress. The lateral
stretch is a power of the stretch in each mode, F = diag(x, x^e) with F33 = x^(-1 - e) (e.g. Holzapfel 2000, section 6.5).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from calibrate.equations.kinematics import invariants_and_derivatives
from calibrate.errors import ConfigError

Array = NDArray[np.float64]
Derivatives = Callable[[Array], Array]
LARGEST_STRETCH = 20.0  # at which the search for an invariant ends


@dataclass(frozen=True)
class Mode:
    """title: for a reader. lateral_exponent e: the lateral stretch is stretch^e."""

    title: str
    lateral_exponent: float

    @property
    def neo_hooke_exponent(self) -> float:
        """n of the neo-Hookean nominal stress mu (x - x^n)."""
        return -3 - 2 * self.lateral_exponent


MODES = {
    "uniaxial": Mode("uniaxial", -0.5),
    "equibiaxial": Mode("equi-biaxial", 1.0),
    "pure_shear": Mode("pure shear", 0.0),
}
TITLES = {name: mode.title for name, mode in MODES.items()}


def stretches_to_gradient(mode: str, stretch: Array) -> Array:
    """In-plane F (k, 2, 2) of a homogeneous `mode` of `MODES` at stretches (k,). Raises `ConfigError` for another mode."""
    if mode not in MODES:
        raise ConfigError(f"mode '{mode}' unknown; choose one of {', '.join(MODES)}")
    stretch = np.asarray(stretch, dtype=np.float64)
    F = np.zeros((stretch.size, 2, 2))
    F[:, 0, 0], F[:, 1, 1] = stretch, stretch ** MODES[mode].lateral_exponent
    return F


def mode_invariants(mode: str, stretch: Array) -> Array:
    """(I1, I2) (k, 2) of a mode at stretches (k,)."""
    return np.asarray(invariants_and_derivatives(jnp.asarray(stretches_to_gradient(mode, stretch)))[0])


def largest_stretch(mode: str, limit: float, invariant: int = 0) -> float:
    """Stretch > 1 at which a mode reaches `limit` of I1 (`invariant` 0) or I2 (1); 1 where that is not above 3, at most `LARGEST_STRETCH`."""
    if limit <= 3.0:
        return 1.0
    if mode_invariants(mode, np.atleast_1d(LARGEST_STRETCH))[0, invariant] <= limit:
        return LARGEST_STRETCH
    return float(
        brentq(lambda x: float(mode_invariants(mode, np.atleast_1d(x))[0, invariant]) - limit, 1.0, LARGEST_STRETCH)
    )


def nominal_stress(derivatives: Derivatives, mode: str, stretch: Array) -> Array:
    """Nominal stress (k,) along the pull from d psi / d(I1, I2) (k, 2) at invariants (k, 2), in the unit of psi."""
    values, first = map(np.asarray, invariants_and_derivatives(jnp.asarray(stretches_to_gradient(mode, stretch))))
    return np.einsum("mk,mk->m", derivatives(values), first[:, :, 0, 0])
