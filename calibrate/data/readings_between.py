"""An Experiment with increments between its pictures, at which only the force is new.

In: an Experiment with a machine record. Out: the same with more increments: displacements between pictures, and the forces of the record.

On a way without a turn displacements are a smooth function of where the crosshead is: a polynomial through the nearest pictures of that way, four at most
(Lagrange). Without a crosshead they go straight in time. Either way they are sums of pictures with weights W, and have their noise, none of their own: with M
the covariance of the noise of the pictures, that of all increments is W M W^T. Of these increments only the equations of the loaded edges are used
(`calibrate.equations.equilibrium`): what is inside tells of interpolated displacements alone.

How well pictures stand for what is between them is told by a polynomial through one picture less: the difference, in proportion to the force, adds to its
noise. Without a crosshead nothing tells of a corner of the loading between two pictures.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment, LoadedBoundary
from calibrate.data.load_record import STANDS, LoadRecord
from calibrate.data.reading_times import reading_times

Array = NDArray[np.float64]
NEAREST = 4  # pictures of a polynomial
NEGLIGIBLE = 0.05  # of the largest force


def with_readings(experiment: Experiment, parts: int, most: int) -> Experiment:
    """With increments at `reading_times`; the Experiment itself where there are none, and where its noise is unknown, which would weigh them. Stereo data
    keep their pictures only."""
    times, noise = reading_times(experiment, parts, most), experiment.noise
    if not times.size or noise is None or experiment.heights is not None or experiment.interpolated is not None:
        return experiment
    record, pictures = experiment.record, experiment.time
    assert record is not None and pictures is not None
    every = np.concatenate([pictures, times])
    order = np.argsort(every)
    found, other = (picture_weights(record, pictures, times, nearest) for nearest in (NEAREST, NEAREST - 1))
    W = np.concatenate([np.eye(len(pictures)), found])[order]
    u = np.concatenate([experiment.displacements, np.einsum("kt,tni->kni", found, experiment.displacements)])
    return replace(
        experiment,
        displacements=u[order],
        time=every[order],
        loaded=_with_forces(experiment, record.at(times), order),
        noise=replace(noise, force_std=float(np.hypot(noise.force_std, _unsure(experiment, found - other)))),
        interpolated=W,
    )


def _with_forces(experiment: Experiment, forces: Array, order: NDArray[np.int64]) -> tuple[LoadedBoundary, ...]:
    """Boundaries with forces (b, k, 2), N, between those at the pictures; NaN for components that are negligible in the whole test, whose errors in
    proportion to the force would be taken for none."""
    size = max(float(np.nanmax(np.abs(b.force), initial=0.0)) for b in experiment.loaded)
    found = []
    for b, force in zip(experiment.loaded, forces, strict=True):
        negligible = ~(np.abs(np.nan_to_num(b.force)).max(axis=0) > NEGLIGIBLE * size)
        force = np.where(negligible & np.array(b.held), np.nan, force * b.held)
        found.append(replace(b, force=np.concatenate([b.force, force])[order]))
    return tuple(found)


def _unsure(experiment: Experiment, difference: Array) -> float:
    """Error of a force, N, for want of pictures: in proportion to the displacements, by what a polynomial through one picture less makes of them;
    difference (k, t): of the weights."""
    u = experiment.displacements
    off = np.einsum("kt,tni->kni", difference, u)
    share = np.sqrt((off**2).mean(axis=(1, 2)).max() / (u**2).mean(axis=(1, 2)).max())
    return float(share) * max(float(np.nanmax(np.abs(b.force), initial=0.0)) for b in experiment.loaded)


def picture_weights(record: LoadRecord, pictures: Array, times: Array, nearest: int = NEAREST) -> Array:
    """Weights (k, t) of the pictures at `pictures` (t,), s, in the displacements at times (k,), s, in between; at rest at 0 s there are none."""
    place = record.progress(pictures, times) - float(pictures[0] == 0)
    knots = pictures if pictures[0] == 0 else np.concatenate([[0.0], pictures])
    first = np.clip(place.astype(np.int64), 0, len(knots) - 2)
    position = knots if record.crosshead is None else np.interp(knots, record.time, record.crosshead)
    way = _ways(np.diff(position), record.crosshead)
    W = np.zeros((len(times), len(knots)))
    for row, i, share in zip(W, first, place - first, strict=True):
        near = np.array([i, i + 1])
        if way[i] >= 0:
            same = np.flatnonzero(way == way[i])
            start = int(np.clip(i + 1 - nearest // 2, same[0], max(same[-1] + 2 - nearest, same[0])))
            near = np.arange(start, min(start + nearest, same[-1] + 2))
        at = position[i] + share * (position[i + 1] - position[i])
        row[near] = [
            _lagrange(position[near], k, at) if way[i] >= 0 else (1 - share, share)[k] for k in range(len(near))
        ]
    return W if pictures[0] == 0 else W[:, 1:]


def _ways(steps: Array, crosshead: Array | None) -> NDArray[np.int64]:
    """Number (k,) of the way without a turn that a step of the crosshead belongs to; -1 where it stands, or was not recorded."""
    if crosshead is None:
        return np.full(len(steps), -1)
    direction = np.where(np.abs(steps) > STANDS * np.ptp(crosshead), np.sign(steps), 0.0)
    number = np.cumsum(np.diff(direction, prepend=direction[0]) != 0)
    return np.where(direction != 0, number, -1)


def _lagrange(knots: Array, k: int, at: float) -> float:
    """At a position, the polynomial that is 1 at knot k and 0 at the others."""
    others = np.delete(knots, k)
    return float(np.prod((at - others) / (knots[k] - others)))
