"""Stiffness over the sheet: what effects of the stage *stiffness* make of it together."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import jax.numpy as jnp

from calibrate.effects.effect import Data, Effect


def stiffness_over_place(data: Data, n_places: int, fields: Iterable[tuple[Effect, Any, Any]]) -> Any:
    """Factor (n_places,) on the stress of the material at each place. fields: effects with their amplitudes (p,) and shapes."""
    place = jnp.ones((1, n_places, 1, 1))
    for effect, amplitudes, shape in fields:
        place = effect.stress(data, None, place, amplitudes, shape)
    return place[0, :, 0, 0]
