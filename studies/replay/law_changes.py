r"""What a change of the law does to the rows of a replay, to first order.

In: rows with their virtual fields, a base with effects of the material. Out: the change of every row,

.. math:: \delta y = h \int \delta P : \nabla v \, dA,

of the difference dP of the stresses of two laws at the replayed displacements, on the camera's triangles, through the chain that the laws were fitted by. Histories are run along
the replayed path.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.diagnosis.problem import Part
from calibrate.effects.chain import Additions, Chain
from calibrate.equations import kinematics
from studies.replay.replay_rows import SheetRows

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LawChanges:
    """A part, its test as it was replayed in all increments (t, n, 2), and the rows of the chosen ones."""

    part: Part
    replayed: Experiment
    rows: SheetRows = field(repr=False)

    @cached_property
    def chain(self) -> Chain:
        """Of the replayed fields, without effects of the measurement."""
        return Chain(replace(self.part.system, experiment=self.replayed), self.part.chain.basis)

    @cached_property
    def _slopes(self) -> Array:
        """Thickness x area x grad v (k, rows, m, 2, 2), mm^2 times the unit of v."""
        e = self.rows.experiment
        operator = kinematics.gradient_operator(e.points, e.triangles)
        v = self.rows.fields
        k, rows, n, _ = v.shape
        flat = operator @ np.moveaxis(v, 2, 0).reshape(n, -1)  # (2 m, k rows 2)
        slopes = flat.reshape(-1, 2, k, rows, 2).transpose(2, 3, 0, 4, 1)
        return slopes * ((e.thickness or 1.0) * self.chain.system.areas)[:, None, None]

    def stress(self, c: Array, additions: Additions) -> Array:
        """P (k, m, 2, 2), MPa, in the chosen increments."""
        return self.chain.stress(c, additions)[self.rows.layout.chosen]

    def of(self, change: Array) -> Array:
        """(k, rows) of a change of P (k, m, 2, 2), MPa."""
        k, rows = self._slopes.shape[:2]
        return np.asarray((self._slopes.reshape(k, rows, -1) @ change.reshape(k, -1, 1))[..., 0])
