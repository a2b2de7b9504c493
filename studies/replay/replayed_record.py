"""The machine record replayed: forces between the pictures of a test that is solved by finite elements.

In: an Experiment with a machine record. Out: moments between its pictures, and `ReplayedRecord`, forces measured and replayed at every reading.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.data.reading_times import reading_times
from calibrate.fitting.calibration import relative_force_error
from forward.solution import SurfaceSolution

Array = NDArray[np.float64]
PARTS, READINGS, MORE = (
    2,
    24,
    60,
)  # of an interval between pictures, at least; over the record, at least; where the force bends, at most


def between_pictures(experiment: Experiment, parts: int) -> list[tuple[float, float]]:
    """Times, s, and load factors between the pictures at which the machine record is replayed, `parts` of each interval at least; none
    without a record."""
    if experiment.record is None or experiment.time is None:
        return []
    n = experiment.n_increments
    times = reading_times(experiment, max(parts, PARTS, -(-READINGS // n)), MORE)
    return list(zip(times.tolist(), (experiment.record.progress(experiment.time, times) / n).tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class ReplayedRecord:
    """Forces over the machine record. solved (k,): times, s, at which the test was solved, pictures among them; forces: {boundary: (k, 2)} N, there.

    time (r,): of the readings, s, from the first that was solved to the last picture; measured: {boundary: (r, 2)} N.
    """

    solved: Array
    forces: dict[str, Array]
    time: Array
    measured: dict[str, Array]

    @classmethod
    def of(cls, experiment: Experiment, solution: SurfaceSolution) -> ReplayedRecord:
        """Of a solution with readings between the pictures."""
        record = experiment.record
        assert record is not None
        times = np.concatenate([solution.time, solution.reading_times])
        order = np.argsort(times)
        nowhere = np.zeros((0, 2))
        forces = {
            b.name: np.array(b.held)
            * np.concatenate([solution.reactions[b.name], solution.readings.get(b.name, nowhere)])[order]
            for b in experiment.loaded
        }
        solved = times[order]
        inside = (record.time >= solved[0]) & (record.time <= solved[-1])
        measured = {b.name: force[inside] for b, force in zip(experiment.loaded, record.force, strict=True)}
        return cls(solved, forces, record.time[inside], measured)

    @cached_property
    def replayed(self) -> dict[str, Array]:
        """{boundary: (r, 2)} N, at the readings: straight lines between the times that were solved."""
        return {
            name: np.stack([np.interp(self.time, self.solved, component) for component in force.T], axis=1)
            for name, force in self.forces.items()
        }

    @property
    def error(self) -> float:
        """Norm of the force errors over that of the measured forces, over all readings."""
        return relative_force_error(self.replayed, self.measured)

    @property
    def largest(self) -> tuple[float, float]:
        """The largest error of a component, N, and its time, s."""
        off = np.array([np.nan_to_num(np.abs(self.replayed[name] - self.measured[name])) for name in self.measured])
        worst = int(off.max(axis=(0, 2)).argmax())
        return float(off[:, worst].max()), float(self.time[worst])
