"""Stiffness or thickness that varies smoothly over the sheet: a field of cosines."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter

ORDER = 3  # of the cosines along either side
SOFTEST = 0.05  # stiffness of a place over the mean, below which it is none that a sheet has


@dataclass(frozen=True)
class StiffnessField(Effect):
    """P times 1 + sum a_kl cos(k pi x) cos(l pi y), k, l up to 3, over the bounding box."""

    name = "stiffness field"
    stage = "stiffness"
    truncated = True
    formula = "P (1 + sum a_kl cos(k pi x) cos(l pi y))"
    amplitudes = tuple(
        Parameter(f"a{k}{l}", "1", lower=-1.0, upper=1.0, typical=0.1)
        for k in range(ORDER + 1)
        for l in range(ORDER + 1)
        if k + l
    )
    decided_by = "strips cut from different places, or a thickness gauge"

    def stress(self, data, F, P, a, shape):
        return P * self._factor(data, a)[:, None, None]

    def is_possible(self, data, a, shape):
        return bool(self._factor(data, jnp.asarray(a)).min() > SOFTEST)

    def _factor(self, data, a):
        """Stiffness (m,) of the triangles over the mean."""
        low, high = data.points.min(axis=0), data.points.max(axis=0)
        x = (data.centroids - low) / (high - low)
        k = jnp.arange(ORDER + 1)
        waves = jnp.cos(jnp.pi * x[:, 0, None] * k)[:, :, None] * jnp.cos(jnp.pi * x[:, 1, None] * k)[:, None, :]
        return 1.0 + waves.reshape(len(x), -1)[:, 1:] @ a
