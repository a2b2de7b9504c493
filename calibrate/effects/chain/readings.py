"""What load cells read at their own times: the forces that the sections carry then.

In: rows of virtual work at the pictures, weights of what is at the pictures in what is at the readings. Out: rows in which the forces are those of the readings.

An interpolation between pictures averages the noise of their displacements, for which any fit is the better, whether or not the clocks differ. So displacements
stay as they are, and of the work only that moves in time which a reading tells of: the force of each loaded boundary, by the best linear unbiased
estimate from all work of a picture (`Equilibrium.force_estimate`). Equations without a load hold at any time, and stay as they are.
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
from calibrate.equations.equilibrium import Equilibrium

Array = NDArray[np.float64]


def moved(system: Equilibrium, work: Array, moves: Array) -> Array:
    """Rows (..., t, 2 v), N, of what the forces of some work (..., t, 2 v) change between the pictures and the readings; moves (t, t): see `moves_of`."""
    loaded, weights = system.force_estimate
    found = np.zeros(work.shape)
    found[..., loaded] = moves @ (work @ weights.T)
    return found


def moved_back(system: Equilibrium, rows: Array, moves: Array) -> Array:
    """The transpose of `moved`: of rows (t, 2 v)."""
    loaded, weights = system.force_estimate
    return np.asarray((moves.T @ rows[:, loaded]) @ weights)


def is_of_the_clock(effect: Effect) -> bool:
    """Whether forces are read at other times than those of the pictures."""
    return type(effect).readings is not Effect.readings


def moves_of(data: Data, additions: Additions) -> Array | None:
    """Weights (t, t) of what is at the pictures in what it changes until the readings; None where nothing does."""
    if not any(is_of_the_clock(a.effect) and not a.is_null for a in additions):
        return None
    return np.asarray(_readings(data, additions)) - np.eye(len(data.u))


def moves_by_parameters(data: Data, additions: Additions, of: Addition, with_shape: bool) -> Array:
    """Derivatives (k, t, t) of these weights by the amplitudes of one of the additions; its shapes, which choose a derivative, have none."""
    slopes = jax.jacfwd(lambda a: _readings(data, additions, of, a))(jnp.array(of.amplitudes))
    found = np.moveaxis(np.asarray(slopes), -1, 0)
    return np.concatenate([found, np.zeros((len(of.shape) if with_shape else 0, *found.shape[1:]))])


def _readings(data: Data, additions: Additions, of: Addition | None = None, a: Any = None) -> Any:
    """Weights (t, t) of what is at the pictures in what is at the readings, with other amplitudes a (p,) of one addition."""
    found = jnp.eye(len(data.u))
    for one in ordered(additions):
        if is_of_the_clock(one.effect):
            found = one.effect.readings(data, a if one is of else jnp.array(one.amplitudes), one.shape) @ found
    return found
