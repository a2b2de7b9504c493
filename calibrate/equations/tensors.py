"""2 x 2 tensors (..., 2, 2) in JAX, by their components: far faster than a factorisation of each."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp


def det(F: Any) -> Any:
    """Determinant (...)."""
    return F[..., 0, 0] * F[..., 1, 1] - F[..., 0, 1] * F[..., 1, 0]


def cofactor(F: Any) -> Any:
    """d det F / dF = det F F^-T, (..., 2, 2)."""
    rows = jnp.stack([F[..., 1, 1], -F[..., 1, 0]], axis=-1), jnp.stack([-F[..., 0, 1], F[..., 0, 0]], axis=-1)
    return jnp.stack(rows, axis=-2)


def inverse(F: Any) -> Any:
    """F^-1 (..., 2, 2)."""
    rows = jnp.stack([F[..., 1, 1], -F[..., 0, 1]], axis=-1), jnp.stack([-F[..., 1, 0], F[..., 0, 0]], axis=-1)
    return jnp.stack(rows, axis=-2) / det(F)[..., None, None]
