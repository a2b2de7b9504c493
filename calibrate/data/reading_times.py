"""At which times between its pictures a test is looked at: where the force of the machine record bends.

In: an Experiment with a machine record. Out: times of readings. Each interval between pictures is divided evenly; then the reading is added that is
furthest from the straight lines between those there are, in force or in the course of the crosshead, until noise is all that is left (Ramer 1972;
Douglas and Peucker 1973). So there are more after a corner of the loading, where a material relaxes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment, LoadRecord

Array = NDArray[np.float64]
NOISE = 4.0  # standard deviations of a reading, by which a force may be off a straight line
FORCE = 2e-3  # of the largest force, where its noise is less, or not known
COURSE = 0.05  # of the way between two pictures
CLOSE = 1e-3  # of an interval, below which two times are one


def reading_times(experiment: Experiment, parts: int, most: int) -> Array:
    """Times (k,), s, between rest at 0 s and the last picture, none of them that of a picture; none without a record.

    parts: of each interval between pictures, at least; most: times that are added to these, where the force bends.
    """
    record = experiment.record
    if record is None or experiment.time is None:
        return np.zeros(0)
    knots = experiment.time if experiment.time[0] == 0 else np.concatenate([[0.0], experiment.time])
    shares = np.arange(1, parts) / parts
    times = (knots[:-1, None] + shares * np.diff(knots)[:, None]).ravel()
    times = times[times > record.time[0]]
    curves = _curves(experiment, record)
    found = np.concatenate([knots, times])
    inside = (record.time > knots[0]) & (record.time < knots[-1])
    at, readings = record.time[inside], curves[:, inside]
    for _ in range(most if inside.any() else 0):
        found = np.sort(found)
        off = np.abs(readings - np.stack([np.interp(at, found, np.interp(found, record.time, c)) for c in curves]))
        off[:, _near(at, found)] = 0.0
        worst = int(off.max(axis=0).argmax())
        if off[:, worst].max() <= 1:
            break
        found = np.append(found, at[worst])
    found = np.setdiff1d(found, knots)
    return found[~_near(found, knots)]


def _curves(experiment: Experiment, record: LoadRecord) -> Array:
    """Forces that were measured, and the course of the crosshead (c, r), each over what it may be off a straight line."""
    assert experiment.time is not None
    forces = np.concatenate([force.T for force in record.force])
    forces = forces[np.isfinite(forces).all(axis=1)]
    noise = experiment.noise
    size = np.abs(forces).max(initial=0.0)
    std = np.zeros(len(forces))
    if noise is not None:
        std = noise.force_deviation(np.abs(forces).max(axis=1, initial=0.0))
    scaled = forces / np.maximum(np.maximum(NOISE * std, FORCE * size), 1e-300)[:, None]
    return np.concatenate([scaled, record.progress(experiment.time, record.time)[None] / COURSE])


def _near(times: Array, others: Array) -> NDArray[np.bool_]:
    """Which of times (k,) are hardly any interval of others (n,) away from one of them."""
    others = np.sort(others)
    place = np.clip(np.searchsorted(others, times), 1, len(others) - 1)
    gap = np.minimum(np.abs(times - others[place - 1]), np.abs(others[place] - times))
    return np.asarray(gap <= CLOSE * np.diff(others).max())
