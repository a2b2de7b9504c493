"""Stiffness or thickness that varies over the sheet: a gradient, or a smooth field of cosines."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter

ORDER = 3


def places(data):
    """Centroids (m, 2) in units of the extent, from the middle."""
    low, high = data.points.min(axis=0), data.points.max(axis=0)
    return (data.centroids - 0.5 * (low + high)) / data.size


@dataclass(frozen=True)
class StiffnessGradient(Effect):
    """P times 1 + gx x + gy y, x and y in units of the extent."""

    name = "stiffness gradient"
    stage = "stiffness"
    formula = "P (1 + gx x + gy y)"
    amplitudes = (Parameter("gx", "1/extent", typical=0.2), Parameter("gy", "1/extent", typical=0.2))
    decided_by = "strips cut from different places, or a thickness gauge"

    def stress(self, data, F, P, a, shape, law):
        return P * (1.0 + places(data) @ a)[:, None, None]


@dataclass(frozen=True)
class StiffnessField(Effect):
    """P times 1 + sum a_kl cos(k pi x) cos(l pi y), k, l up to 3, over the bounding box."""

    name = "stiffness field"
    stage = "stiffness"
    truncated = True
    formula = "P (1 + sum a_kl cos(k pi x) cos(l pi y))"
    amplitudes = tuple(
        Parameter(f"a{k}{l}", "1", typical=0.1) for k in range(ORDER + 1) for l in range(ORDER + 1) if k + l
    )
    decided_by = "strips cut from different places, or a thickness gauge"

    def stress(self, data, F, P, a, shape, law):
        low, high = data.points.min(axis=0), data.points.max(axis=0)
        x = (data.centroids - low) / (high - low)
        k = jnp.arange(ORDER + 1)
        waves = jnp.cos(jnp.pi * x[:, 0, None] * k)[:, :, None] * jnp.cos(jnp.pi * x[:, 1, None] * k)[:, None, :]
        return P * (1.0 + waves.reshape(len(x), -1)[:, 1:] @ a)[:, None, None]
