"""Initial warp: a sheet that was not flat in the reference picture, and is pulled flat by the first load.

A strip of slope q in the reference picture is seen shortened by 1 - q^2 / 2 and regains that length as the sheet flattens:
a strain along the strip, without contraction and without stress, that stays the same in every later picture,

    u_true = u - sum a_k P_k(x) e_x - sum b_k P_k(y) e_y,   dP_k/dx = p_k, the Legendre polynomials over the extent, k = 1 .. 4.

Each component depends on its own coordinate, as where the sheet was bent to a cylinder about one of the axes; P_k vanishes at
both ends. The same strain everywhere (k = 0) is left out: it cannot be told from the material at small strain.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter

ORDER = 4
STEEPEST = 0.01  # strain; a slope of 8 degrees


@dataclass(frozen=True)
class InitialWarp(Effect):
    """Displacements lose a smooth part that is the same in all increments; a_k along x, b_k along y."""

    name = "initial warp"
    stage = "measurement"
    formula = "u - sum a_k P_k(x) e_x - sum b_k P_k(y) e_y, in all increments"
    amplitudes = tuple(
        Parameter(f"{letter}{k}", "1", lower=-STEEPEST, upper=STEEPEST, typical=0.002)
        for letter in "ab"
        for k in range(1, ORDER + 1)
    )
    decided_by = "a reference picture under a small load, or a second camera"

    def missing(self, data):
        return None if len(data.u) > 2 else "more increments"

    def displacements(self, data, u, a, shape):
        low, high = data.points.min(axis=0), data.points.max(axis=0)
        x = 2.0 * (data.points - low) / (high - low) - 1.0
        moved = 0.5 * (high - low) * integrals(x)  # (k, n, 2)
        return u - jnp.einsum("ik,kni->ni", jnp.reshape(a, (2, ORDER)), moved)


def integrals(x):
    """Integrals (ORDER, ...) of the Legendre polynomials p_1 .. from -1 to x, x in [-1, 1]: (p_(k+1) - p_(k-1)) / (2 k + 1)."""
    p = [jnp.ones_like(x), x]
    for k in range(1, ORDER + 1):
        p.append(((2 * k + 1) * x * p[k] - k * p[k - 1]) / (k + 1))
    return jnp.stack([(p[k + 1] - p[k - 1]) / (2 * k + 1) for k in range(1, ORDER + 1)])
