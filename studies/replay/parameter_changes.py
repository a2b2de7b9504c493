"""What the parameters of a model do to a replay, to first order.

In: a test with its rows, and the `Directions` of a model. Out: derivatives of measured minus replayed. Functions of the base, and amplitudes and shapes of the material, change
the law (`law_changes`); amplitudes of camera, clock and load cell change what was measured.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.replayed.parameter_spread import Directions
from calibrate.effects.chain import Additions
from calibrate.effects.chain.true_surface import true_surface
from studies.replay.compared_test import ComparedTest, is_solved
from studies.replay.law_changes import LawChanges
from studies.replay.replay_rows import SheetRows

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Model = tuple[Array, Additions]  # coefficients (n,) and effects


def of_parameters(test: ComparedTest, changes: LawChanges, directions: Directions, level: float, used: Mask) -> Array:
    """Derivatives (k rows, p + k) of measured minus replayed of one test by the unknowns; zero for those that are not used (p + k,)."""
    rows, layout = changes.rows, test.layout
    scale = np.where(layout.is_force, level, 1.0)
    before = changes.stress(directions.c, _solved(test.part.valid(directions.additions)))
    columns = np.zeros((rows.measured.size, len(directions.sizes)))
    for i in np.flatnonzero(used):
        c, additions = directions.moved(int(i))
        own = test.part.valid(additions)
        change = -scale * changes.of(changes.stress(c, _solved(own)) - before)
        if i >= directions.base.shape[1]:
            change = change + _of_correction(test, rows, own, test.part.valid(directions.additions))
        columns[:, i] = change.ravel() / directions.sizes[i]
    return columns


def of_change(test: ComparedTest, changes: LawChanges, before: Model, after: Model) -> Array:
    """Change (k rows,) of measured minus replayed of one test from one model to another, at the same displacements."""
    (c, old), (d, new) = ((c, test.part.valid(additions)) for c, additions in (before, after))
    change = -changes.of(changes.stress(d, _solved(new)) - changes.stress(c, _solved(old)))
    return (change + _of_correction(test, changes.rows, new, old)).ravel()


def _solved(additions: Additions) -> Additions:
    return tuple(a for a in additions if is_solved(a.effect.name))


def _of_correction(test: ComparedTest, rows: SheetRows, additions: Additions, before: Additions) -> Array:
    """(k, rows): change of measured minus replayed by other amplitudes of effects of the measurement."""
    some, others = (tuple(a for a in all_of if not is_solved(a.effect.name)) for all_of in (additions, before))
    if some == others:
        return np.zeros(rows.measured.shape)
    bare = replace(test.experiment, noise=None)
    new, old = (true_surface(bare, each).select(test.layout.chosen) for each in (some, others))
    moved = np.einsum("krni,kni->kr", rows.prescribed, new.displacements - old.displacements)
    forces = [
        [b.force[:, axis] for b, axis in ((e.loaded[b], axis) for b, axis in test.layout.sides)] for e in (new, old)
    ]
    if forces[0]:
        moved[:, : len(forces[0])] += np.stack(forces[0], axis=1) - np.stack(forces[1], axis=1)
    return np.asarray(moved)
