"""What a change of a model does to a replay, and its parameters to first order.

In: a test with its rows, and the `Directions` of a model. Out: changes and derivatives of measured minus replayed. Functions of the base, and amplitudes and shapes of the material, change
the law (`law_changes`); amplitudes of camera, clock and load cell change what was measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.replayed.parameter_spread import Directions
from calibrate.effects.chain import Additions
from calibrate.effects.chain.true_surface import true_surface
from studies.replay.compared_test import ComparedTest
from studies.replay.law_changes import LawChanges
from studies.replay.model_law import is_solved
from studies.replay.replay_rows import SheetRows

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Departure:
    """A model of a test that was replayed, c (n,) and effects, from which another one differs; level: of the forces of both."""

    test: ComparedTest
    changes: LawChanges
    c: Array
    additions: Additions
    level: float = 1.0

    @cached_property
    def _stress(self) -> Array:
        return self.changes.stress(self.c, _solved(self.test.part.valid(self.additions)))

    def to(self, c: Array, additions: Additions) -> Array:
        """Change (k rows,) of measured minus replayed, at the same displacements."""
        before, after = (self.test.part.valid(some) for some in (self.additions, additions))
        scale = np.where(self.test.layout.is_force, self.level, 1.0)
        change = -scale * self.changes.of(self.changes.stress(c, _solved(after)) - self._stress)
        return (change + _of_correction(self.test, self.changes.rows, after, before)).ravel()


def of_parameters(test: ComparedTest, changes: LawChanges, directions: Directions, level: float, used: Mask) -> Array:
    """Derivatives (k rows, p + k) of measured minus replayed of one test by the unknowns; zero for those that are not used (p + k,)."""
    start = Departure(test, changes, directions.c, directions.additions, level)
    columns = np.zeros((changes.rows.measured.size, len(directions.sizes)))
    for i in np.flatnonzero(used).tolist():
        columns[:, i] = _derivative(start, directions, i)
    return columns


def _derivative(start: Departure, directions: Directions, i: int) -> Array:
    """(k rows,) by the i-th unknown, from the side where there is a stress: a compressible sheet has none beyond some amplitudes."""
    found = start.to(*directions.moved(i))
    side = 1.0 if np.isfinite(found).all() else -1.0
    return (found if side > 0 else start.to(*directions.moved(i, side))) / (side * directions.sizes[i])


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
