"""Initial warp: a sheet that was not flat in the reference picture, and is pulled flat by the first load.

A strip of slope q in the reference picture is seen shortened by 1 - q^2 / 2 and regains that length as the sheet flattens,
without stress. Later pictures are right; it is the reference that is too short, by the factor 1 - e along either axis, where
the sheet was bent to a cylinder about the other:

    e_x = sum a_k p_k(x),   e_y = sum b_k p_k(y),   p_k Legendre polynomials over the extent, k = 0 .. 4.

A bend shortens, whatever its sign, so that the means a_0 and b_0 are not negative. With A = diag(1 + e_x, 1 + e_y), the
gradient of the places in the flat sheet by the seen ones, the elastic deformation gradient is F A^-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from calibrate.effects.effect import Effect, Parameter, lacks_plane_stress

ORDER = 4
STEEPEST = 0.01  # strain; a slope of 8 degrees
NEXT_ORDERS = 0.5  # a_5 over a_3 and a_6 over a_4: what a smooth bend leaves beyond the polynomials
FLAT = 1e-4  # strain that a sheet would regain, below which a measured reference counts as flat


@dataclass(frozen=True)
class InitialWarp(Effect):
    """The reference regains a smooth strain; a_k along x, b_k along y."""

    name = "initial warp"
    stage = "measurement"
    truncated = True
    formula = "F A^-1, A = diag(1 + sum a_k p_k(x), 1 + sum b_k p_k(y))"
    amplitudes = tuple(
        Parameter(f"{letter}{k}", "1", lower=-STEEPEST if k else 0.0, upper=STEEPEST, typical=0.002)
        for letter in "ab"
        for k in range(ORDER + 1)
    )
    alone = (tuple(range(ORDER + 1)), tuple(range(ORDER + 1, 2 * (ORDER + 1))))
    decided_by = "a reference picture under a small load, or a second camera"

    def excluded(self, data):
        return data.reference_height is not None and regained_strain(data.points, data.reference_height) < FLAT

    def missing(self, data):
        return lacks_plane_stress(data) or (None if len(data.u) > 2 else "more increments")

    def places(self, data, X, a, shape):
        low, high = X.min(axis=0), X.max(axis=0)
        x = 2.0 * (X - low) / (high - low) - 1.0
        a = jnp.reshape(a, (2, ORDER + 1))
        regained = jnp.einsum(
            "ik,kni->ni", jnp.concatenate([a, data.doubt * NEXT_ORDERS * a[:, -2:]], axis=1), integrals(x)
        )
        return X + 0.5 * (high - low) * regained


def regained_strain(points, height):
    """Largest q^2 / 2 of a reference of height (n,), mm, at points (n, 2), mm; q: slopes of a polynomial of total degree ORDER through it."""
    points, height = np.asarray(points), np.asarray(height)
    x, y = (2.0 * (p - p.min()) / np.ptp(p) - 1.0 for p in points.T)
    powers = [(i, j) for i in range(ORDER + 1) for j in range(ORDER + 1 - i)]
    known = np.isfinite(height)
    design = np.stack([x**i * y**j for i, j in powers], axis=1)
    fit, *_ = np.linalg.lstsq(design[known], height[known], rcond=None)
    along = sum(c * i * x ** max(i - 1, 0) * y**j for c, (i, j) in zip(fit, powers, strict=True))
    across = sum(c * j * x**i * y ** max(j - 1, 0) for c, (i, j) in zip(fit, powers, strict=True))
    slopes = 2.0 * np.stack([along, across]) / np.ptp(points, axis=0)[:, None]
    return float(0.5 * (slopes**2).max())


def integrals(x):
    """Legendre polynomials integrated from -1 to x (ORDER + 3, ...) in [-1, 1], the two next ones with them."""
    p = [jnp.ones_like(x), x]
    for k in range(1, ORDER + 3):
        p.append(((2 * k + 1) * x * p[k] - k * p[k - 1]) / (k + 1))
    return jnp.stack([x + 1.0, *((p[k + 1] - p[k - 1]) / (2 * k + 1) for k in range(1, ORDER + 3))])
