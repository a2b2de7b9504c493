r"""Bounded, damped least squares in JAX, from many starts at once.

In: a residual function, its data, starts and lower bounds. Out: `Solutions`, with the reason why each start stopped.
Minimises |residual(theta)|^2 + decay |theta|^2 for theta >= lower by Levenberg-Marquardt with the scaling of Marquardt (1963):
steps go through the active bounds' complement and are cut off at the bounds. Compiled once for each residual function and
shape of the data, so that residual functions are hashable and hold no arrays. One that knows a short way to its derivative has a
method `jacobian(theta, data)` (rows, p).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.fitting.stopping import Stop

Array = NDArray[np.float64]
Residual = Callable[[Any, Any], Any]
TOLERANCE = 1e-6  # by default
SMALL_STEPS = 3  # small steps in a row after which a start has converged
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-12, 1e12


@dataclass(frozen=True)
class Solutions:
    """Of every start: parameters (s, p), objectives (s,), iterations (s,) and why it stopped."""

    parameters: Array
    objectives: Array
    iterations: NDArray[np.int64]
    reasons: tuple[Stop, ...]


def levenberg_marquardt(
    residual: Residual, data: Any, starts: Any, lower: Any, limit: int, decay: float = 0.0, floor: float = 0.0,
    tolerance: float = TOLERANCE,
) -> Solutions:  # fmt: skip
    """Minimise |residual(theta, data)|^2 + decay |theta|^2 from starts (s, p), theta >= lower (p,).

    limit: iterations of each start. floor: the part of the loss that no parameter can change; decreases are judged against
    objective + floor. tolerance: relative decrease below which a step counts as small.
    """
    theta, value, count, small, damping = map(
        np.asarray, _solve(residual, data, starts, lower, limit, decay, floor, tolerance)
    )
    reasons = tuple(_reason(*state) for state in zip(value, small, damping, strict=True))
    return Solutions(theta, value, count, reasons)


def _reason(value: float, small: int, damping: float) -> Stop:
    if not np.isfinite(value):
        return Stop.NOT_FINITE
    if small >= SMALL_STEPS:
        return Stop.CONVERGED
    return Stop.NO_DESCENT if damping >= MOST_DAMPING else Stop.ITERATION_LIMIT


def _damped_step(J: jax.Array, g: jax.Array, diagonal: jax.Array) -> jax.Array:
    """(J^T J + diag(diagonal))^-1 g, solved in the smaller of the two spaces."""
    rows, columns = J.shape
    if columns <= rows:
        return jnp.linalg.solve(J.T @ J + jnp.diag(diagonal), g)
    scaled = J / diagonal
    return g / diagonal - scaled.T @ jnp.linalg.solve(jnp.eye(rows) + scaled @ J.T, scaled @ g)


@partial(jax.jit, static_argnums=(0, 4))
def _solve(residual, data, starts, lower, limit: int, decay, floor, tolerance):
    """Parameters, objectives, iterations, small steps at the end and last damping of every start."""

    jacobian = getattr(residual, "jacobian", jax.jacfwd(residual))

    def objective(theta):
        r = residual(theta, data)
        return r @ r + decay * (theta @ theta)

    def proceed(state):
        _, _, damping, count, small = state
        return (count < limit) & (small < SMALL_STEPS) & (damping < MOST_DAMPING)

    def step(state):
        theta, value, damping, count, small = state
        r, J = residual(theta, data), jacobian(theta, data)
        g = J.T @ r + decay * theta
        free = ~((theta <= lower) & (g > 0))  # active bounds stay where they are
        J, g = J * free, g * free
        scale = jnp.sum(J * J, axis=0)
        diagonal = decay + damping * (scale + 1e-12 * jnp.max(scale) + 1e-30)
        trial = jnp.maximum(theta - _damped_step(J, g, diagonal), lower)
        new = objective(trial)
        good = jnp.isfinite(new) & (new < value)
        is_small = good & (value - new < tolerance * (value + floor))
        small = jnp.where(good, jnp.where(is_small, small + 1, 0), small)
        damping = jnp.where(good, jnp.maximum(damping / 5, LEAST_DAMPING), damping * 4)
        return jnp.where(good, trial, theta), jnp.where(good, new, value), damping, count + 1, small

    def solve(start):
        state = (start, objective(start), FIRST_DAMPING, 0, jnp.array(0))
        theta, value, damping, count, small = jax.lax.while_loop(proceed, step, state)
        return theta, value, count, small, damping

    return jax.vmap(solve)(starts)
