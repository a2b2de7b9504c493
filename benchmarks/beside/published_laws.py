"""Laws in plane strain as stress functions: the truth of NN-EUCLID's data, and classical laws with free parameters.

In: F (n, 2, 2) with F33 = 1. Out: P (n, 2, 2) in the unit of the moduli, by automatic differentiation of the energy.
Energies and parameters of the truth: Thakolkaran et al. 2022, J. Mech. Phys. Solids 169, 105076, section 4.1; invariants with a bar
are isochoric, J^(-2/3) I1 and so on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Energy = Callable[[Any, Any], Any]  # of F (2, 2) and parameters
TINY = 1e-14  # keeps the root of equal stretches differentiable
FIBRE_ANGLE = 30.0  # degrees, of both families in the Holzapfel solid


def _parts(F: Any) -> tuple[Any, Any, Any]:
    """J, isochoric C (2, 2), and its C33."""
    J = F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
    scale = J ** (-2.0 / 3.0)
    return J, scale * F.T @ F, scale


def _squares(F: Any) -> tuple[Any, Any, Any, Any]:
    """J and squares of the isochoric principal stretches."""
    J, C, third = _parts(F)
    mean, half = 0.5 * (C[0, 0] + C[1, 1]), 0.5 * (C[0, 0] - C[1, 1])
    root = jnp.sqrt(half**2 + C[0, 1] * C[1, 0] + TINY)
    return J, mean + root, mean - root, third


def ogden(F: Any, p: Any) -> Any:
    """mu/alpha sum (stretch^alpha - 1) + kappa/2 (J - 1)^2, p = (mu, alpha, kappa); shear modulus mu alpha / 2."""
    mu, alpha, kappa = p
    J, *squares = _squares(F)
    return mu / alpha * sum(s ** (alpha / 2) - 1 for s in squares) + kappa / 2 * (J - 1) ** 2


def neo_hooke(F: Any, p: Any) -> Any:
    """mu/2 (I1bar - 3) + kappa/2 (J - 1)^2, p = (mu, kappa)."""
    J, C, third = _parts(F)
    return p[0] / 2 * (C[0, 0] + C[1, 1] + third - 3) + p[1] / 2 * (J - 1) ** 2


def yeoh(F: Any, p: Any) -> Any:
    """c1 (I1bar - 3) + c2 (..)^2 + c3 (..)^3 + kappa/2 (J - 1)^2, p = (c1, c2, c3, kappa)."""
    J, C, third = _parts(F)
    x = C[0, 0] + C[1, 1] + third - 3
    return p[0] * x + p[1] * x**2 + p[2] * x**3 + p[3] / 2 * (J - 1) ** 2


def holzapfel(F: Any, p: Any) -> Any:
    """mu/2 (I1bar - 3) + kappa/2 (J - 1)^2 + k1/(2 k2) sum (exp(k2 (Iabar - 1)^2) - 1) over fibres at +-angle;
    p = (mu, kappa, k1, k2, angle in degrees)."""
    mu, kappa, k1, k2, angle = p
    J, C, third = _parts(F)
    radians = angle * jnp.pi / 180
    energy = mu / 2 * (C[0, 0] + C[1, 1] + third - 3) + kappa / 2 * (J - 1) ** 2
    for sign in (1, -1):
        a = jnp.array([jnp.cos(radians), sign * jnp.sin(radians)])
        energy += k1 / (2 * k2) * (jnp.exp(k2 * (a @ C @ a - 1) ** 2) - 1)
    return energy


@dataclass(frozen=True)
class Law:
    """An energy with parameters. names: of the parameters; start: of a fit."""

    name: str
    energy: Energy
    names: tuple[str, ...]
    start: tuple[float, ...]

    def stress(self, F: Array, parameters: Array) -> Array:
        """P (..., 2, 2) at F (..., 2, 2)."""
        flat = _stress(self.energy, jnp.asarray(F.reshape(-1, 2, 2)), jnp.asarray(parameters, float))
        return np.asarray(flat).reshape(F.shape)

    def sensitivity(self, F: Array, parameters: Array) -> Array:
        """dP/d parameters (q, ..., 2, 2)."""
        flat = _sensitivity(self.energy, jnp.asarray(F.reshape(-1, 2, 2)), jnp.asarray(parameters, float))
        return np.moveaxis(np.asarray(flat), -1, 0).reshape(len(parameters), *F.shape)

    def stress_and_sensitivity(self, F: Array, parameters: Array) -> tuple[Array, Array]:
        """Both of the above, as a fit takes them."""
        return self.stress(F, parameters), self.sensitivity(F, parameters)


def _stress_of_one(energy: Energy, F: Any, p: Any) -> Any:
    return jax.grad(energy)(F, p)


@jax.jit(static_argnums=0)
def _stress(energy: Energy, F: Any, p: Any) -> Any:
    return jax.vmap(lambda f: _stress_of_one(energy, f, p))(F)


@jax.jit(static_argnums=0)
def _sensitivity(energy: Energy, F: Any, p: Any) -> Any:
    return jax.vmap(lambda f: jax.jacfwd(lambda q: _stress_of_one(energy, f, q))(p))(F)


# mu/alpha (2 x 0.65 / 0.65 = 2) of powers 1.3 of the stretches, and kappa/2 = 1.5
TRUTHS = {
    "Ogden": (Law("Ogden", ogden, ("mu", "alpha", "kappa"), ()), np.array([2.6, 1.3, 3.0])),
    "Holzapfel": (
        Law("Holzapfel", holzapfel, ("mu", "kappa", "k1", "k2", "angle"), ()),
        np.array([1.0, 2.0, 0.9, 0.8, FIBRE_ANGLE]),
    ),
}
CLASSICAL = (
    Law("neo-Hooke", neo_hooke, ("mu", "kappa"), (1.0, 2.0)),
    Law("Yeoh", yeoh, ("c1", "c2", "c3", "kappa"), (0.5, 0.0, 0.0, 2.0)),
    Law("Ogden, one term", ogden, ("mu", "alpha", "kappa"), (1.0, 2.0, 2.0)),
)
FIBROUS = Law("two fibres (Holzapfel)", holzapfel, ("mu", "kappa", "k1", "k2", "angle"), (1.0, 2.0, 0.5, 0.5, 45.0))
