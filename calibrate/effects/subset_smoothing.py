"""Smoothing by the subsets of the correlation, inside the specimen and at its edges."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp

from calibrate.effects.effect import Effect, Parameter
from calibrate.effects.support.borders import subset_moments
from calibrate.effects.support.nodal_derivatives import gradient_matrices, second_derivatives


@dataclass(frozen=True)
class SubsetSmoothing(Effect):
    """A displacement is read at the middle of a plane fitted over a subset; s2 is the variance of the subset's weights.

    Inside, measured = u + s2 lap(u) / 2. At an edge, which cuts off part of a square of `side`, the plane misreads a
    quadratic field by another tensor of moments, even of the other sign (`calibrate.effects.support.borders`). The square is that
    of variance s2 = side^2 / 12; `side` stands for it where s2 is not known yet.

    Where the test has a twin, squares are laid on its finite elements: the camera's triangles know no second derivatives at holes, and amplify their
    noise, which no subset has smoothed. Else the formula, of second order in s2.
    """

    name = "subset smoothing"
    stage = "correlation"
    of_rig = True
    truncated = True
    formula = "u + s2 M : grad grad u / 2, M: moments of a square cut by edges"
    source = "Schreier and Sutton 2002"
    amplitudes = (Parameter("s2", "mm^2", lower=0.0, typical=1.0),)
    shapes = (Parameter("side", "mm", lower=0.0),)
    shapes_vary = False
    decided_by = "the same pictures correlated with smaller subsets"
    rough = True
    reads_twin = True

    def shape_values(self, data):
        pitch = float(jnp.sqrt(2.0 * jnp.median(data.areas)))
        return [(4 * pitch,), (2 * pitch,), (pitch,), (0.5 * pitch,)]

    def displacements(self, data, u, a, shape):
        if data.twin is not None:
            return u - a[0] * data.twin.subsets.at(_side(a[0], shape))
        moments = subset_moments(data.lines, _side(a[0], shape))

        def change(u):
            return 0.5 * a[0] * jnp.einsum("nij,tncij->tnc", moments, second_derivatives(data, u))

        return u - change(u - change(u))

    def adjoint(self, data, places, a, shape):
        if data.twin is not None:
            return lambda u, rows: rows
        moments = np.asarray(subset_moments(data.lines, _side(a[0], shape)))
        slopes = gradient_matrices(data)
        change = sum(
            sp.diags_array(0.5 * float(a[0]) * moments[:, i, j]) @ slopes[j] @ slopes[i]
            for i in range(2)
            for j in range(2)
        )
        transposed = sp.csr_array(change.T)

        def seen(u, rows):
            columns = np.moveaxis(rows, 1, 0).reshape(len(moments), -1)
            back = columns - transposed @ (columns - transposed @ columns)
            return np.moveaxis(back.reshape(-1, len(rows), 2), 0, 1)

        return seen


def _side(s2, shape):
    """Of the square, mm."""
    known = s2 > 0
    return jnp.where(known, jnp.sqrt(12.0 * jnp.where(known, s2, 1.0)), shape[0])
