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


def laplacian(data, u):
    """Recovered Laplacian (t, n, 2) of displacements (t, n, 2), 1/mm."""
    columns = []
    for i in range(2):
        first = gradient_at_nodes(data, u[..., i])
        second = [gradient_at_nodes(data, first[..., j])[..., j] for j in range(2)]
        columns.append(second[0] + second[1])
    return jnp.stack(columns, axis=-1)
