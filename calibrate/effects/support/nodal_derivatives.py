"""Derivatives of nodal fields on triangles: area-weighted means at the nodes, slopes at the centroids.

A derivative is a sum over a stencil, of as many terms for every place. The terms are added up one after the other, each for some places, whose sums stay in the cache
of a core, and with all values of a node side by side: faster than a contraction, and without memory for the values of the stencil.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp

from calibrate.equations import isochoric as plane_strain

AT_ONCE = 64  # places


def stencil_sum(stencil, weights, values):
    """sum_k weights[p, k, j] values[:, stencil[p, k]]: (t, p, ..., j) of values (t, n, ...), a stencil (p, k) and weights (p, k, j)."""
    rows = jnp.moveaxis(values, 1, 0).reshape(values.shape[1], -1)
    count = len(stencil)
    parts = -(-count // AT_ONCE)

    def together(one):
        """(parts, AT_ONCE, ...) of one (p, ...), with zeros at the end."""
        return jnp.pad(one, ((0, parts * AT_ONCE - count), *((0, 0),) * (one.ndim - 1))).reshape(
            parts, AT_ONCE, *one.shape[1:]
        )

    def of_some(some):
        def add(total, one):
            nodes, weight = one
            return total + rows[nodes][:, None, :] * weight[:, :, None], None

        nodes, weight = some
        start = jnp.zeros((AT_ONCE, weight.shape[2], rows.shape[1]))
        return jax.lax.scan(add, start, (nodes.T, jnp.moveaxis(weight, 1, 0)))[0]

    total = jax.lax.map(of_some, (together(stencil), together(weights)))
    total = total.reshape(parts * AT_ONCE, *total.shape[2:])[:count]
    found = total.reshape(*total.shape[:2], values.shape[0], *values.shape[2:])
    return jnp.moveaxis(jnp.moveaxis(found, 2, 0), 2, -1)


def gradients(data, u):
    """F (t, m, 2, 2) at the centroids of displacements (t, n, 2)."""
    return jnp.eye(2) + stencil_sum(data.stencil, data.slopes, u)


def reference_gradients(data, places):
    """Gradient (m, 2, 2) at the centroids of true places (n, 2) by the measured ones of the reference."""
    return gradients(data, (places - data.points)[None])[0]


def law_gradients(data, u):
    """What effects take for the deformation gradient (t, m, 2, 2) at displacements (t, n, 2)."""
    F = gradients(data, u)
    return F if data.plane == "stress" else plane_strain.isochoric(F)


def to_nodes(data, values):
    """Area-weighted means (..., n) at the nodes of values (..., m) in the triangles."""
    weights = jnp.repeat(data.areas, 3)
    nodes = data.triangles.ravel()
    n = len(data.points)
    total = jnp.zeros(n).at[nodes].add(weights)
    flat = jnp.repeat(values, 3, axis=-1) * weights
    return jnp.zeros((*values.shape[:-1], n)).at[..., nodes].add(flat) / total


def slopes(data, nodal):
    """Gradient (..., m, 2) at the centroids of a nodal field (..., n)."""
    flat = nodal.reshape(-1, nodal.shape[-1])
    return stencil_sum(data.stencil, data.slopes, flat).reshape(*nodal.shape[:-1], len(data.stencil), 2)


def gradient(data, nodal, nodes=None):
    """Gradient at the nodes (t, n, ..., 2) of nodal values (t, n, ...), from quadratics over two rings of neighbours; at some nodes (p,) alone
    where these are given."""
    if nodes is None:
        return stencil_sum(data.rings, data.ring_slopes, nodal)
    return stencil_sum(data.rings[nodes], data.ring_slopes[nodes], nodal)


def gradient_matrices(data):
    """Matrices (n, n) along x and y that do what `gradient` does to one nodal value (n,)."""
    return [stencil_matrix(data.rings, data.ring_slopes[:, :, k]) for k in range(2)]


def stencil_matrix(stencil, weights):
    """The matrix (n, n) of a stencil (n, k) of as many places as nodes, with weights (n, k)."""
    n, k = stencil.shape
    return sp.csr_array((np.asarray(weights).ravel(), np.asarray(stencil).ravel(), k * np.arange(n + 1)), shape=(n, n))


def second_derivatives(data, u):
    """Second derivatives (t, n, 2, 2, 2), 1/mm, of displacements (t, n, 2): gradients at the nodes of such gradients
    (`calibrate.equations.recovery.nodal_gradients`)."""
    second = gradient(data, gradient(data, u))
    return 0.5 * (second + jnp.swapaxes(second, -1, -2))
