"""Rows of replays that the parameters of a model are fitted by, with their derivatives: what `updating`, `field_fit` and `few_effects` ask for.

In: computed elsewhere. Out: `ReplayedRows`, and `Replays`, a function of base and effects.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.replayed.observations import Observations
from calibrate.diagnosis.replayed.parameter_spread import Directions
from calibrate.effects.chain import Additions
from calibrate.effects.support.effect_data import Data

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class ReplayedRows:
    """Of the increments that were fitted. near: measured minus replayed (N,) of other coefficients (n,) and effects at these displacements; slopes: its derivatives
    (N, 1 + k) by the unknowns of `Directions`; zero for those that are not asked for (1 + k,). tests: which limit the amplitudes."""

    rows: Observations
    near: Callable[[Array, Additions], Array] = field(repr=False)
    slopes: Callable[[Directions, Mask], Array] = field(repr=False)
    tests: tuple[Data, ...] = field(repr=False)


Replays = Callable[[Array, Additions], ReplayedRows | None]  # None where there is no equilibrium
