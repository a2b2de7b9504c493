"""What noise of the displacements does to the stress: its mean change, and moduli that amplify it.

In: deformation gradients, a base model, effects in the material. Out: change of the mean stress (t, m, 2, 2), MPa, and dP/dF
(t, m, 2, 2, 2, 2), MPa.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.effects.chain.linearisation import Constants, Linearisation
from calibrate.effects.chain.quantities import STRESS, Base
from calibrate.effects.chain.stages import deformation_name
from calibrate.effects.support.nodal_derivatives import gradients
from calibrate.equations import isochoric

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@partial(jax.jit, static_argnums=0)
def stress_shift(base: Base, constants: Constants, axes: Any) -> Any:
    """Change (t, m, 2, 2), MPa, of the mean stress of the base, of second order in the noise.

    With v the axes (m, 2, 2), the mean stress is P(F) plus half of P(F + e v) + P(F - e v) - 2 P(F) for e along x and y
    (sigma points; Julier and Uhlmann 1997).
    """
    F = gradients(constants.data, constants.data.u)

    def stress(F: Any) -> Any:
        P = base.stress(constants, isochoric.isochoric(F) if base.plane_strain else F)
        return isochoric.stress(F, P, constants.c[-1]) if base.plane_strain else P

    change = -4.0 * stress(F)
    for q in range(2):
        for i in range(2):
            step = jnp.zeros((axes.shape[0], 2, 2)).at[:, i, :].set(axes[:, :, q])
            change = change + 0.5 * (stress(F + step) + stress(F - step))
    return change


@dataclass(frozen=True, eq=False)
class Moduli:
    """dP/dF of a block in some increments (k,): moduli (k, b, 2, 2, 2, 2), MPa, by F of the same increment; own, others (k,): their squares, and
    those of dP/dF by other increments, times the areas."""

    moduli: Array
    own: Array
    others: Array


def tangent_moduli(
    run: Linearisation, base: Base, places: Indices, used: int, areas: Array, increments: Indices, remembers: bool
) -> Moduli:
    """Of a run from F to P, of base and effects in the material, in the first `used` of the triangles `places` (b,); areas (m,), mm^2, of all;
    remembers: whether stress depends on earlier increments. Of all earlier increments the chosen ones stand for those near them."""
    name = deformation_name(base)
    t, b = run.start[name].shape[:2]
    k = len(increments)
    weights = areas[places][:used, None, None]
    own, others, squares = np.zeros((k, used, 2, 2, 2, 2)), np.zeros(k), np.zeros(k)
    stands_for = np.bincount(np.abs(np.arange(t)[:, None] - increments).argmin(axis=1), minlength=k)
    units = jnp.broadcast_to(jnp.eye(4).reshape(4, 1, 1, 2, 2), (4, t, b, 2, 2))
    inner, outer = run.split_at(STRESS)
    changes = inner.push({name: units})
    for some in [[j] for j in range(k)] if remembers else [list(range(k))]:
        only = jnp.zeros((t, 1, 1, 1)).at[increments[some]].set(1.0)
        dP = np.asarray(outer.push({key: only * change for key, change in changes.items()})[STRESS])
        dP = dP[:, increments, :used]
        own[some] = np.moveaxis(dP[:, some].reshape(2, 2, len(some), used, 2, 2), (0, 1), (4, 5))
        sizes = (weights * dP**2).sum(axis=(0, 2, 3, 4))
        squares[some] = sizes[some]
        sizes[some] = 0.0
        others += sizes * (stands_for[some[0]] if remembers else 1)
    return Moduli(own, squares, others)
