"""What a testing machine records of a simulated history: forces at the pictures and between them, and the crosshead.

In: a solution with readings on the way to its increments. Out: a `LoadRecord` from rest to the last picture; the crosshead's unit is the load factor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import LoadRecord

Array = NDArray[np.float64]
READINGS = 4  # random stream


class LoadCell(Protocol):
    """What reads forces, see `studies.synthetic.camera`."""

    def force_factors(self, names: Sequence[str], count: int, seed: int, key: int = ...) -> dict[str, Array]: ...


def simulated_record(solution: Any) -> LoadRecord | None:
    """Exact forces; None where the solution has no readings between its increments."""
    if not len(getattr(solution, "reading_times", ())):
        return None
    description = solution.description
    times = np.concatenate([[0.0], solution.time, solution.reading_times])
    factors = np.concatenate([[0.0], description["load_factors"], [factor for _, factor in description["readings"]]])
    order = np.argsort(times)
    rest = np.zeros((1, 2))
    forces = [np.concatenate([rest, solution.reactions[side], solution.readings[side]]) for side in solution.reactions]
    return LoadRecord(times[order], np.array(forces)[:, order], factors[order])


def as_read(clean: LoadRecord, pictures: Array, names: Sequence[str], camera: LoadCell, seed: int) -> LoadRecord:
    """The record of boundaries with these names as `camera`'s load cell reads it: at the pictures (t,), s, as there."""
    at_picture = np.isin(clean.time, pictures)
    of_pictures = camera.force_factors(names, len(pictures), seed)
    between = camera.force_factors(names, int((~at_picture).sum()), seed, READINGS)
    factors = np.ones((len(names), len(clean.time)))
    for row, name in zip(factors, names, strict=True):
        row[at_picture], row[~at_picture] = of_pictures[name][np.isin(pictures, clean.time)], between[name]
    return replace(clean, force=clean.force * factors[..., None])
