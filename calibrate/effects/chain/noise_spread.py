"""What noise of the displacements does to the stress: its mean change, and moduli that amplify it.

In: deformation gradients, a base model, effects in the material. Out: change of the mean stress (t, m, 2, 2), MPa, and dP/dF
(t, m, 2, 2, 2, 2), MPa.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.effects.chain.linearisation import Constants, Linearisation
from calibrate.effects.chain.quantities import STRESS, Base
from calibrate.effects.chain.stages import deformation_name
from calibrate.effects.support.nodal_derivatives import gradients
from calibrate.equations import isochoric

Array = NDArray[np.float64]


def gradient_axes(gradient: sp.csr_array, factor: Any) -> Array:
    """Axes (m, 2, 2), in columns, of the covariance of a displacement component's gradient in each triangle.

    gradient (2 m, n): operator; factor (n, s): noise as a map of independent normal numbers.
    """
    spread = sp.csr_array(gradient @ factor)
    x, y = spread[0::2], spread[1::2]
    xy = np.asarray((x * y).sum(axis=1)).ravel()
    square = [np.asarray((part * part).sum(axis=1)).ravel() for part in (x, y)]
    covariance = np.stack([np.stack([square[0], xy], axis=1), np.stack([xy, square[1]], axis=1)], axis=1)
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]


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


def tangent_moduli(run: Linearisation, base: Base, areas: Array, remembers: bool) -> Array:
    """dP/dF (t, m, 2, 2, 2, 2), MPa, times the root of 1 + |dP/dF of other increments|^2 over its own.

    run: from F to P, of base and effects in the material; areas (m,), mm^2; remembers: whether stress depends on earlier
    increments.
    """
    name = deformation_name(base)
    t, m = run.start[name].shape[:2]
    areas = areas[:, None, None]
    own, others = np.zeros((t, m, 2, 2, 2, 2)), np.zeros(t)
    units = jnp.broadcast_to(jnp.eye(4).reshape(4, 1, 1, 2, 2), (4, t, m, 2, 2))
    inner, outer = run.split_at(STRESS)
    changes = inner.push({name: units})
    for some in [[j] for j in range(t)] if remembers else [list(range(t))]:
        only = jnp.zeros((t, 1, 1, 1)).at[np.array(some)].set(1.0)
        dP = np.asarray(outer.push({key: only * change for key, change in changes.items()})[STRESS])
        own[some] = np.moveaxis(dP[:, some].reshape(2, 2, len(some), m, 2, 2), (0, 1), (4, 5))
        sizes = (areas * dP**2).sum(axis=(0, 2, 3, 4))
        sizes[some] = 0.0
        others += sizes
    sizes = (areas[..., None, None] * own**2).sum(axis=(1, 2, 3, 4, 5))
    return own * np.sqrt(1 + others / sizes)[:, None, None, None, None, None]
