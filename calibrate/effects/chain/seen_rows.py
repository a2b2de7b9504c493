"""Rows of work by the displacements that a camera saw, of those by the corrected ones: the transposed corrections, one increment at a time.

In: a run of the corrections of displacements, rows by corrected displacements. Out: rows by seen ones.

Corrections are slopes at every node by its own displacement; those of rough effects, which look at their neighbours, know their transposes themselves
(`Effect.adjoint`).
"""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.effects.chain.linearisation import Constants, Linearisation, Quantities, Step
from calibrate.effects.chain.link import push
from calibrate.effects.chain.links_of_motion import OfEffect
from calibrate.effects.chain.quantities import DISPLACEMENTS, MEASURED, PLACES
from calibrate.effects.effect import Effect

Array = NDArray[np.float64]
Transposed = Callable[[int, Array], Array]
VALUES = 400_000  # points times rows that are transposed at once


class SeenRows:
    """correction: from measured to corrected displacements."""

    def __init__(self, correction: Linearisation) -> None:
        steps = correction.steps[::-1]
        make = [_rough if _effect(step).rough else _at_nodes for step in steps]
        self.transposed = tuple(of(correction.constants, step) for of, step in zip(make, steps, strict=True))

    def __call__(self, rows: Array, increment: int) -> Array:
        """Rows (r, n, 2) by seen displacements, of rows by corrected ones."""
        if not self.transposed:
            return rows
        size, found = max(1, VALUES // rows.shape[1]), np.empty_like(rows)
        for first in range(0, len(rows), size):
            some = rows[first : first + size]
            for transposed in self.transposed:
                some = transposed(increment, some)
            found[first : first + size] = some
        return found


def by_measured(duals: Quantities) -> Array:
    """Duals (k, t, n, 2) of the measured displacements, which corrections read as such and start from."""
    found = np.asarray(duals[DISPLACEMENTS])
    return found + np.asarray(duals[MEASURED]) if MEASURED in duals else found


def _rough(constants: Constants, step: Step) -> Transposed:
    link = step.stage.link
    ((a, shape),) = step.stage.parameters
    places = step.inputs[link.reads.index(PLACES)] if PLACES in link.reads else constants.data.points
    adjoint = _effect(step).adjoint(constants.data, np.asarray(places), np.asarray(a), np.asarray(shape))
    u = np.asarray(step.inputs[0])
    return lambda i, rows: adjoint(u[i], rows)


def _at_nodes(constants: Constants, step: Step) -> Transposed:
    """By slopes (2, t, n, 2): of both components by each."""
    u, link = step.inputs[0], step.stage.link
    units = jnp.broadcast_to(jnp.eye(2)[:, None, None, :], (2, *u.shape))
    given = step.inputs, constants.of(link), step.stage.parameters
    slopes = np.asarray(push(link, *given, (units, *(None for _ in step.inputs[1:]))))
    return lambda i, rows: np.einsum("rnc,knc->rnk", rows, slopes[:, i])


def _effect(step: Step) -> Effect:
    assert isinstance(step.stage.link, OfEffect)
    return step.stage.link.effect
