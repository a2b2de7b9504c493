"""Forces at the pictures, of a load cell that is read at other times.

In: weights of what is at the pictures in what is at the readings, and the readings. Out: the forces that the sections carry at the pictures.

The readings are what moves in time, as they have the least noise. To interpolate displacements, or forces that follow from them, averages their noise: any fit is
then better, or worse, by chance, whether or not the clocks differ. What is interpolated is still what the sections carry, between pictures on one branch of the
history: the forces f at the pictures are those with W f = F, the readings, as a history turns at a picture and not at a reading. Waves that are as good as unseen at
the readings (those of two pictures, at a lag of 0.7 intervals) are left as they were read (ridge regression; Tikhonov 1963).
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.effects.chain.addition import Addition, Additions, ordered
from calibrate.effects.effect import Effect
from calibrate.effects.support.effect_data import Data

Array = NDArray[np.float64]
RIDGE = 1e-4  # square of the share of a wave that is seen at the readings, below which it stays as it was read


def is_of_the_clock(effect: Effect) -> bool:
    """Whether forces are read at other times than those of the pictures."""
    return type(effect).readings is not Effect.readings


def are_of_the_clock(additions: Additions) -> bool:
    """Whether any of them moves what is read."""
    return any(is_of_the_clock(a.effect) and not a.is_null for a in additions)


def reading_weights(data: Data, additions: Additions) -> Array:
    """Weights (t, t) of what is at the pictures in what is at the readings."""
    return np.asarray(_weights(data, additions))


def picture_weights(data: Data, additions: Additions) -> Array:
    """Weights (t, t) of the readings in the forces at the pictures."""
    return np.asarray(_inverse(_weights(data, additions)))


def picture_weights_by_parameters(data: Data, additions: Additions, of: Addition, with_shape: bool) -> Array:
    """Derivatives (k, t, t) of these by the amplitudes of one of the additions; its shapes, which choose a derivative, have none."""
    slopes = jax.jacfwd(lambda a: _inverse(_weights(data, additions, of, a)))(jnp.array(of.amplitudes))
    found = np.moveaxis(np.asarray(slopes), -1, 0)
    return np.concatenate([found, np.zeros((len(of.shape) if with_shape else 0, *found.shape[1:]))])


def at_pictures(weights: Array, loads: Any, read: Array, data: Data) -> Array:
    """Forces (..., t, 2, b), N, at the pictures, of readings that effects correct; weights (..., t, t); read (t, 2, b): as they were, NaN where they are missing. Such a one is
    interpolated linearly in time."""
    found, known, time = np.array(loads), np.isfinite(read), np.asarray(data.time)
    for i, b in zip(*np.nonzero(known.any(axis=0) & ~known.all(axis=0)), strict=True):
        there, missing = np.flatnonzero(known[:, i, b]), np.flatnonzero(~known[:, i, b])
        between = np.array([np.interp(time[missing], time[there], row) for row in np.eye(len(there))])
        found[..., missing, i, b] = found[..., there, i, b] @ between
    return np.einsum("...ts,...sib->...tib", weights, found)


def of_pictures(loads: Any, read: Array, data: Data, additions: Additions) -> Any:
    """Forces (..., t, 2, b), N, at the times of the pictures, of readings that effects correct."""
    if not are_of_the_clock(additions):
        return loads
    return at_pictures(picture_weights(data, additions), loads, read, data)


def filled(loads: Any, read: Array, data: Data, additions: Additions) -> Any:
    """Readings (t, 2, b), N, as `at_pictures` takes them beside effects of the clock; else as they are."""
    return at_pictures(np.eye(len(read)), loads, read, data) if are_of_the_clock(additions) else loads


def _weights(data: Data, additions: Additions, of: Addition | None = None, a: Any = None) -> Any:
    """Weights (t, t) of what is at the pictures in what is at the readings, with other amplitudes a (p,) of one addition."""
    found = jnp.eye(len(data.u))
    for one in ordered(additions):
        if is_of_the_clock(one.effect):
            found = one.effect.readings(data, a if one is of else jnp.array(one.amplitudes), one.shape) @ found
    return found


def _inverse(W: Any) -> Any:
    """Weights (t, t) of the readings in f, the solution of W f = F that is closest to F."""
    eye = jnp.eye(len(W))
    return eye + W.T @ jnp.linalg.solve(W @ W.T + RIDGE * eye, eye - W)
