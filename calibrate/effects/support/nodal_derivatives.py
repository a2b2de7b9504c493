"""Derivatives of nodal fields on triangles: area-weighted means at the nodes, slopes at the centroids."""

from __future__ import annotations

import jax.numpy as jnp

from calibrate.equations import isochoric as plane_strain


def gradients(data, u):
    """F (t, m, 2, 2) at the centroids of displacements (t, n, 2)."""
    return jnp.eye(2) + jnp.einsum("tmki,mkj->tmij", u[:, data.stencil], data.slopes)


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
    return jnp.einsum("...mk,mkj->...mj", nodal[..., data.stencil], data.slopes)


def gradient(data, nodal):
    """Gradient at the nodes (t, n, ..., 2) of nodal values (t, n, ...), from quadratics over two rings of neighbours."""
    return jnp.einsum("tnk...,nkj->tn...j", nodal[:, data.rings], data.ring_slopes)


def second_derivatives(data, u):
    """Second derivatives (t, n, 2, 2, 2), 1/mm, of displacements (t, n, 2): gradients at the nodes of such gradients
    (`calibrate.equations.recovery.nodal_gradients`)."""
    second = gradient(data, gradient(data, u))
    return 0.5 * (second + jnp.swapaxes(second, -1, -2))
