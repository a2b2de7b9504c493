"""The surface of a thick specimen is not its mean: the leading effect of thickness on what a camera sees.

With u_3 = F33 Z the shear C_aZ of a thick sheet is Z F33 dF33/dX_a, and must vanish where the surfaces are free of
traction. So the in-plane displacement bends over the thickness, u = mean + (Z^2 - h^2 / 12) w with C_aZ = 0, that is
w = -F33 F^-T grad F33 / 2, and the mean, for which the equations of plane stress hold, is

    mean = surface + h^2 / 12 F33 F^-T grad F33.

The linear version is the parabola of generalised plane stress (Michell 1899; Timoshenko and Goodier, section 98).
"""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter
from calibrate.effects.recovery import gradient_at_nodes, slopes, to_nodes


@dataclass(frozen=True)
class Thickness(Effect):
    """Displacements of the mid-surface from those of the surface; b = h^2 / 12 is expected."""

    name = "3D effect of thickness"
    stage = "kinematics"
    formula = "u + b F33 F^-T grad F33, b = h^2 / 12"
    amplitudes = (Parameter("b", "mm^2", lower=0.0, typical=10.0),)
    decided_by = "a thinner specimen of the same shape"

    def displacements(self, data, u, a, shape):
        F = jnp.eye(2) + jnp.stack([slopes(data, u[..., i]) for i in range(2)], axis=-2)
        det = F[..., 0, 0] * F[..., 1, 1] - F[..., 0, 1] * F[..., 1, 0]
        thinning = to_nodes(data, 1.0 / det)
        steep = gradient_at_nodes(data, thinning)
        Fn = jnp.stack(
            [jnp.stack([to_nodes(data, F[..., i, j]) for j in range(2)], axis=-1) for i in range(2)], axis=-2
        )
        bend = jnp.linalg.solve(jnp.swapaxes(Fn, -1, -2), steep[..., None])[..., 0]
        return u + a[0] * thinning[..., None] * bend
