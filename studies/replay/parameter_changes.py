"""What the uncertainty of a fit makes of a replay, to first order.

In: a test with its rows, and a `Spread` of parameters. Out: changes of measured minus replayed along a root of their covariance. Functions of the base, and amplitudes and shapes of the material, change
the law (`law_changes`); amplitudes of camera, clock and load cell change what was measured.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.replayed.parameter_spread import Spread
from calibrate.effects.chain import Additions
from calibrate.effects.chain.true_surface import true_surface
from studies.replay.compared_test import ComparedTest, is_solved
from studies.replay.law_changes import LawChanges
from studies.replay.replay_rows import SheetRows

Array = NDArray[np.float64]


def of_parameters(test: ComparedTest, changes: LawChanges, spread: Spread, level: float) -> Array:
    """(k rows, q) of one test."""
    rows, layout = changes.rows, test.layout
    scale = np.where(layout.is_force, level, 1.0)
    solved = _solved(test.part.valid(spread.fit.additions))
    before = changes.stress(spread.fit.c, solved)
    columns = []
    for i in range(len(spread.sizes)):
        if not spread.root[i].any():
            columns.append(np.zeros(rows.measured.size))
            continue
        c, additions = spread.moved(i)
        own = test.part.valid(additions)
        change = -scale * changes.of(changes.stress(c, _solved(own)) - before)
        if i >= spread.base.shape[1]:
            change = change + _of_correction(test, rows, own, test.part.valid(spread.fit.additions))
        columns.append(change.ravel() / spread.sizes[i])
    return np.stack(columns, axis=1) @ spread.root


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
