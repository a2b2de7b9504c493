"""Kinematics of linear triangles (T3) in incompressible plane stress.

In: reference points (n, 2) mm, triangles (m, 3), displacements (..., n, 2) mm.
Out: in-plane deformation gradients F (..., m, 2, 2), invariants and their derivatives with respect to F.

Incompressibility fixes F33 = 1/det F and the plane-stress condition P33 = 0 fixes the pressure, so that the
in-plane first Piola-Kirchhoff stress is the plain derivative of the energy psi(I1(F), I2(F)) by the in-plane
F (e.g. Holzapfel 2000, section 6.5): with C = F^T F

    I1 = tr C + 1 / det C,        I2 = det C + tr C / det C.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]
INVARIANTS = ("I1", "I2")


def invariants(F: jax.Array) -> jax.Array:
    """I1 and I2 (2,) of one in-plane deformation gradient (2, 2)."""
    trace = jnp.sum(F * F)
    det = (F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]) ** 2
    return jnp.stack([trace + 1.0 / det, det + trace / det])


@jax.jit
def invariants_and_derivatives(F: jax.Array) -> tuple[jax.Array, jax.Array]:
    """I (..., 2) and dI/dF (..., 2, 2, 2) of deformation gradients (..., 2, 2)."""
    flat = F.reshape(-1, 2, 2)
    values = jax.vmap(invariants)(flat)
    derivatives = jax.vmap(jax.jacrev(invariants))(flat)
    return values.reshape(F.shape[:-2] + (2,)), derivatives.reshape(F.shape[:-2] + (2, 2, 2))


@jax.jit
def invariant_hessians(F: jax.Array) -> jax.Array:
    """d2I/dF2 (..., 2, 2, 2, 2, 2) of deformation gradients (..., 2, 2)."""
    flat = F.reshape(-1, 2, 2)
    return jax.vmap(jax.hessian(invariants))(flat).reshape(F.shape[:-2] + (2, 2, 2, 2, 2))


def shape_gradients(points: Array, triangles: NDArray[np.int64]) -> tuple[Array, Array]:
    """Gradients dN/dX (m, 3, 2) in 1/mm and areas (m,) in mm^2 of linear triangles (m, 3) of points (n, 2), mm."""
    x = points[triangles]
    edges = np.stack([x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]], axis=1)
    inverse = np.linalg.inv(edges)
    local = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    gradients = np.einsum("mij,kj->mki", inverse, local)
    return gradients, 0.5 * np.linalg.det(edges)


def gradient_operator(points: Array, triangles: NDArray[np.int64]) -> sp.csr_array:
    """Sparse operator (2 m, n), 1/mm: nodal values to their gradient, row 2 e + j = derivative by X_j in triangle e.

    points (n, 2) mm, triangles (m, 3).
    """
    gradients, _ = shape_gradients(points, triangles)
    m = len(triangles)
    rows = np.broadcast_to(np.arange(2 * m).reshape(m, 1, 2), (m, 3, 2))
    columns = np.broadcast_to(triangles[:, :, None], (m, 3, 2))
    return sp.csr_array(
        (gradients.ravel(), (rows.ravel(), columns.ravel())), shape=(2 * m, len(points)), dtype=np.float64
    )


def deformation_gradients(operator: sp.csr_array, displacements: Array) -> Array:
    """F (..., m, 2, 2) from `gradient_operator` and displacements (..., n, 2), mm: F_iJ = delta_iJ + du_i/dX_J."""
    leading, n = displacements.shape[:-2], displacements.shape[-2]
    u = np.moveaxis(displacements.reshape(-1, n, 2), 1, 0).reshape(n, -1)
    g = (operator @ u).reshape(-1, 2, u.shape[1] // 2, 2)
    F = np.moveaxis(g, 2, 0).swapaxes(-1, -2) + np.eye(2)
    return np.ascontiguousarray(F).reshape(*leading, -1, 2, 2)


@partial(jax.jit, static_argnums=0)
def nominal_stress(energy, F: jax.Array) -> jax.Array:
    """In-plane P (..., 2, 2) = d psi / d F for `energy`: (2,) invariants -> scalar, F (..., 2, 2); in the energy's
    unit."""
    psi = lambda f: energy(invariants(f))  # noqa: E731
    return jax.vmap(jax.grad(psi))(F.reshape(-1, 2, 2)).reshape(F.shape)


def gradient_axes(gradient: sp.csr_array, factor: sp.csr_array) -> Array:
    """Axes (m, 2, 2), in columns, of the covariance of a displacement component's gradient in each triangle.

    gradient (2 m, n): operator; factor (n, s): see `noise_factor`.
    """
    spread = sp.csr_array(gradient @ factor)
    x, y = spread[0::2], spread[1::2]
    xy = np.asarray((x * y).sum(axis=1)).ravel()
    square = [np.asarray((part * part).sum(axis=1)).ravel() for part in (x, y)]
    covariance = np.stack([np.stack([square[0], xy], axis=1), np.stack([xy, square[1]], axis=1)], axis=1)
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
