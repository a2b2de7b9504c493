"""The stress that an exported law is compared with: that of the model itself, in JAX, in incompressible plane stress.

In: in-plane deformation gradients F (t, n, 2, 2), a history, at times (t,), s. Out: nominal stress P (t, n, 2, 2) in the unit of the model.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.effects.chain import Additions, ordered
from calibrate.effects.chain.base_law import base_law
from calibrate.equations.basis import SingleBasis
from calibrate.equations.kinematics import invariants

Array = NDArray[np.float64]
Stress = Callable[[Any, Any], Any]
INTERVALS = 160  # of the integral of the power: exponential fibres need as many


def stress_of_energy(energy: Callable[[Any], Any], F: Any, time: Any) -> Any:
    """P of an energy of (I1, I2) (2,)."""
    slope = jax.vmap(jax.grad(lambda f: energy(invariants(f))))
    return slope(F.reshape(-1, 2, 2)).reshape(F.shape)


def stress_of_extended(basis: SingleBasis, c: Array, additions: Additions, F: Any, time: Any) -> Any:
    """P of the base with coefficients c (n,) and effects of the material, compressibility left out."""
    P = base_law(basis.k, basis.n, basis.top, jnp.asarray(c), F)
    data: Any = SimpleNamespace(time=time)
    relaxing = [a for a in additions if a.effect.stage == "relaxation"]
    for a in ordered(additions):
        if a not in relaxing:  # compressibility leaves this stress as it is
            P = a.effect.stress(data, F, P, jnp.asarray(a.amplitudes), a.shape)
    return P + sum(a.effect.stress(data, F, P, jnp.asarray(a.amplitudes), a.shape) - P for a in relaxing)


def point_stress(stress: Stress, F: Array) -> Array:
    """P (n, 2, 2) at F (n, 2, 2), reached at once."""
    return np.asarray(jax.jit(partial(_single, stress))(jnp.asarray(F)))


def point_tangent(stress: Stress, F: Array) -> Array:
    """dP/dF (n, 2, 2, 2, 2) at F (n, 2, 2)."""
    return np.asarray(jax.jit(jax.vmap(jax.jacfwd(lambda f: _single(stress, f[None])[0])))(jnp.asarray(F)))


def point_energy_and_stress(stress: Stress, F: Array) -> tuple[Array, Array]:
    """Work (n,) of the stress from rest to F (n, 2, 2), along I + r^2 (U - I) with F = R U, by composite Gauss quadrature; P (n, 2, 2)."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    r = ((np.arange(INTERVALS)[:, None] + (nodes + 1) / 2) / INTERVALS).ravel()
    w = np.tile(weights, INTERVALS) / (2 * INTERVALS) * 2 * r
    _, sizes, turn = np.linalg.svd(F)
    way = np.einsum("nki,nk,nkj->nij", turn, sizes, turn) - np.eye(2)
    path = np.eye(2) + r[:, None, None, None] ** 2 * way
    P = point_stress(stress, np.concatenate([path.reshape(-1, 2, 2), F]))
    work = np.einsum("r,rnij,nij->n", w, P[: -len(F)].reshape(path.shape), way)
    return work, P[-len(F) :]


def _single(stress: Stress, F: Any) -> Any:
    return stress(F[None], jnp.ones(1))[0]
