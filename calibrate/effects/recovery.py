"""Derivatives of nodal fields on triangles: area-weighted means at the nodes, slopes at the centroids."""

from __future__ import annotations

import jax.numpy as jnp


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
    return jnp.einsum("...mk,mkj->...mj", nodal[..., data.stencil], data.slopes)


def gradient_at_nodes(data, nodal):
    """Recovered gradient (..., n, 2) of a nodal field (..., n)."""
    found = slopes(data, nodal)
    return jnp.stack([to_nodes(data, found[..., j]) for j in range(2)], axis=-1)


def second_derivatives(data, u):
    """Second derivatives (t, n, 2, 2, 2), 1/mm, of displacements (t, n, 2): gradients at the nodes of such gradients, each
    from quadratics over two rings of neighbours (`calibrate.recovery.nodal_gradients`)."""
    first = jnp.einsum("tnkc,nkj->tncj", u[:, data.rings], data.ring_slopes)
    second = jnp.einsum("tnkcj,nki->tncji", first[:, data.rings], data.ring_slopes)
    return 0.5 * (second + jnp.swapaxes(second, -1, -2))
