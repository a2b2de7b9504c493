"""An elliptic inclusion of another stiffness or thickness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from calibrate.effects.effect import Effect, Parameter
from calibrate.effects.stiffness_field import SOFTEST

# Circles that are tried: places along the longest side, and the radius over it.
GRID = ((8, 1 / 12), (4, 1 / 6), (4, 1 / 3))
EDGE = 0.2  # over the root of a triangle's area: the share of it within a line through it is about a logistic function of this width
ROUND = 1e-6  # of the square of half the logarithm of the ratio of the axes, below which series are used


@dataclass(frozen=True)
class Inclusion(Effect):
    """P times 1 + a within an ellipse: of a triangle that its edge cuts by the share that is within.

    radius: root of the product of its half axes. (e1, e2) = e (cos 2t, sin 2t), with e half the logarithm of the ratio of its axes and t the angle
    of the long one to x: they are 0, and smooth, where it is a circle.
    """

    name = "inclusion"
    stage = "stiffness"
    formula = "P (1 + a) within half axes radius exp(+-e) about (x, y) from the middle, the long one at t to x, (e1, e2) = e (cos 2t, sin 2t)"
    amplitudes = (Parameter("a", "1", lower=SOFTEST - 1, upper=20.0, typical=0.2),)
    shapes = (
        Parameter("x", "extent", lower=-1.0, upper=1.0, typical=0.1, may_be_zero=True),
        Parameter("y", "extent", lower=-1.0, upper=1.0, typical=0.1, may_be_zero=True),
        Parameter("radius", "extent", lower=0.01, upper=1.0, typical=0.1),
        Parameter("e1", "1", lower=-1.5, upper=1.5, typical=0.5, may_be_zero=True),
        Parameter("e2", "1", lower=-1.5, upper=1.5, typical=0.5, may_be_zero=True),
    )
    former_shape = (0.0, 0.0)
    nested_in = "stiffness field"  # nearly: beside fifteen free cosines its place and radius stand in for anything
    decided_by = "the sheet looked at against the light, or a thickness gauge"

    def shape_values(self, data):
        places = (np.asarray(data.centroids) - np.asarray(data.centre)) / float(data.size)
        found = []
        for places_along, radius in GRID:
            step = 1 / places_along
            cells = np.unique(np.floor(places / step).astype(int), axis=0)
            found += [(*((cell + 0.5) * step).tolist(), radius, 0.0, 0.0) for cell in cells]
        return found

    def located(self, data, shape):
        size = float(data.size)
        x, y = np.asarray(data.centre) + size * np.array(shape[:2])
        long, short, angle = half_axes(*shape[2:])
        return (
            f"within {size * long:.3g} mm by {size * short:.3g} mm, the long axis at {np.degrees(angle):.0f} degrees to x, of ({x:.3g}, {y:.3g}) mm"
            if long > 1.02 * short
            else f"within {size * shape[2]:.3g} mm of ({x:.3g}, {y:.3g}) mm"
        )

    def share_of(self, data, shape):
        """Share of the area of the sheet that it covers."""
        return float(self._inside(data, jnp.asarray(shape)) @ data.areas / data.areas.sum())

    def stress(self, data, F, P, a, shape):
        return P * (1.0 + a[0] * self._inside(data, shape))[:, None, None]

    def _inside(self, data, shape):
        """Share (m,) of every triangle that is within."""
        depth = _depth((data.centroids - data.centre) / data.size - jnp.stack([shape[0], shape[1]]), shape[2:])
        return jax.nn.sigmoid(depth / (EDGE * jnp.sqrt(data.areas) / data.size))


def half_axes(radius: float, e1: float, e2: float) -> tuple[float, float, float]:
    """Long and short half axis, in the unit of the radius, and the angle of the long one to x, rad, from 0 to pi."""
    e = float(np.hypot(e1, e2))
    return radius * np.exp(e), radius * np.exp(-e), 0.5 * np.arctan2(e2, e1) % np.pi


def _depth(place: Any, shape: Any) -> Any:
    """Distance (m,) of places (m, 2), from the middle, to the edge, positive within; to first order: exact of a circle and at the edge, too deep inside a flat ellipse near its tips."""
    radius, e1, e2 = shape
    squared = e1**2 + e2**2
    e = jnp.sqrt(jnp.where(squared > ROUND, squared, 1.0))
    along = jnp.where(squared > ROUND, jnp.cosh(e), 1 + squared / 2)
    across = jnp.where(squared > ROUND, jnp.sinh(e) / e, 1 + squared / 6)
    to_circle = jnp.array([[along - across * e1, -across * e2], [-across * e2, along + across * e1]])
    y = place @ to_circle  # of a point of the edge at the distance of the radius
    distance, slope = (jnp.sqrt((z**2).sum(axis=1) + 1e-18) for z in (y, y @ to_circle))
    return (radius - distance) * distance / slope
