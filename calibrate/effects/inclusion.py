"""A round inclusion of another stiffness or thickness."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from calibrate.effects.effect import Effect, Parameter

GRID = ((8, 1 / 12), (4, 1 / 6), (4, 1 / 3))  # tried: places along the longest side, and the radius over it
EDGE = 0.2  # over the root of a triangle's area: the share of it within a line through it is about a logistic function of this width


@dataclass(frozen=True)
class Inclusion(Effect):
    """P times 1 + a within a circle: of a triangle that the circle cuts by the share that is within."""

    name = "inclusion"
    stage = "stiffness"
    formula = "P (1 + a) within `radius` of (x, y) from the middle"
    amplitudes = (Parameter("a", "1", lower=-1.0, upper=20.0, typical=0.2),)
    shapes = (
        Parameter("x", "extent", lower=-0.5, upper=0.5, typical=0.1, may_be_zero=True),
        Parameter("y", "extent", lower=-0.5, upper=0.5, typical=0.1, may_be_zero=True),
        Parameter("radius", "extent", lower=0.01, upper=0.5, typical=0.1),
    )
    nested_in = "stiffness field"  # nearly: beside fifteen free cosines its place and radius stand in for anything
    decided_by = "the sheet looked at against the light, or a thickness gauge"

    def shape_values(self, data):
        places = (np.asarray(data.centroids) - np.asarray(data.centre)) / float(data.size)
        found = []
        for places_along, radius in GRID:
            step = 1 / places_along
            cells = np.unique(np.floor(places / step).astype(int), axis=0)
            found += [(*((cell + 0.5) * step).tolist(), radius) for cell in cells]
        return found

    def located(self, data, shape):
        x, y = np.asarray(data.centre) + float(data.size) * np.array(shape[:2])
        return f"within {float(data.size) * shape[2]:.3g} mm of ({x:.3g}, {y:.3g}) mm"

    def stress(self, data, F, P, a, shape):
        distance = jnp.linalg.norm((data.centroids - data.centre) / data.size - jnp.stack([shape[0], shape[1]]), axis=1)
        edge = EDGE * jnp.sqrt(data.areas) / data.size
        return P * (1.0 + a[0] * jax.nn.sigmoid((shape[2] - distance) / edge))[:, None, None]
