"""A run of the chain through some triangles in some increments: what a block of either leaves, rows of virtual work alone.

In: a block of triangles with all increments, or all triangles with some increments where a stage looks at its neighbours and none back in time.
Out: the virtual work of P, or of its changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.effects.chain.blocks import Block
from calibrate.effects.chain.linearisation import Linearisation, Quantities
from calibrate.effects.chain.quantities import DISPLACEMENTS, MEASURED, STRESS

Array = NDArray[np.float64]
OF_INCREMENTS = (MEASURED, DISPLACEMENTS)  # that are read increment by increment


@dataclass(frozen=True, eq=False)
class BlockRun:
    """steps: from true displacements to P. seen: the increments of the run; the first `first` of these belong to another one, so that all are
    of one size."""

    block: Block
    steps: Linearisation
    seen: slice = slice(None)
    first: int = 0

    @property
    def increments(self) -> slice:
        """Those of its own."""
        return slice(self.seen.start + self.first, self.seen.stop) if self.first else self.seen

    def of_increments(self, changes: Quantities) -> Quantities:
        """Changes (p, ...) of quantities in its increments, of those in all."""
        return {name: value[:, self.seen] if name in OF_INCREMENTS else value for name, value in changes.items()}

    def work(self, quantities: Quantities) -> Any:
        """Virtual work (..., t, 2 v), N, of stresses (..., t, b, 2, 2) in its own increments."""
        return self.block.work(quantities[STRESS])[..., self.first :, :]
