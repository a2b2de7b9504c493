"""An inclusion of another stiffness or thickness: a circle, an ellipse, a rectangle, or what is between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.effects.effect import Effect, Parameter
from calibrate.effects.stiffness_field import SOFTEST

Array = NDArray[np.float64]
# Circles that are tried: places along the longest side, and the radius over it.
GRID = ((8, 1 / 12), (4, 1 / 6), (4, 1 / 3))
EDGE = 0.2  # over the root of a triangle's area: the share of it within a line through it is about a logistic function of this width
ROUND = 1e-6  # of the squares of half the logarithm of the ratio of the axes and of q, below which series are used
CORNER = 1e-6  # that no corner is quite sharp
SQUARE = float(np.log(4 / np.pi))  # logarithm of the area of a square of half side 1 over that of a circle of radius 1
SHARP = 3.0  # q from which corners are sharp: a fit ends there or before, since nothing changes beyond
CORNERS = 0.5  # squareness from which corners are told


@dataclass(frozen=True)
class Inclusion(Effect):
    """P times 1 + a within an outline: of a triangle that it cuts by the share that is within.

    radius: of the circle of its area, nearly. (e1, e2) = e (cos 2t, sin 2t), with e half the logarithm of the ratio of its axes and t the angle of the
    long one to x. (q1, q2) = q (cos 4u, sin 4u), with q between 0 of an ellipse and `SHARP` of a parallelogram, and u the angle of the normal of
    a side to x before the outline is stretched. They are 0, and the outline smooth in them, where it is a circle or an ellipse. The outline of a given
    squareness is the squircle of Fernandez Guasti (Int. J. Math. Educ. Sci. Technol. 23, 1992).
    """

    name = "inclusion"
    stage = "stiffness"
    formula = (
        "P (1 + a) within half axes radius exp(+-e) about (x, y) from the middle, the long one at t to x, (e1, e2) = e (cos 2t, sin 2t); "
        "with four corners where q is large, (q1, q2) = q (cos 4u, sin 4u), the sides normal to u before the stretch"
    )
    amplitudes = (Parameter("a", "1", lower=SOFTEST - 1, upper=20.0, typical=0.2),)
    shapes = (
        Parameter("x", "extent", lower=-1.0, upper=1.0, typical=0.1, may_be_zero=True),
        Parameter("y", "extent", lower=-1.0, upper=1.0, typical=0.1, may_be_zero=True),
        Parameter("radius", "extent", lower=0.01, upper=1.0, typical=0.1),
        Parameter("e1", "1", lower=-1.5, upper=1.5, typical=0.5, may_be_zero=True),
        Parameter("e2", "1", lower=-1.5, upper=1.5, typical=0.5, may_be_zero=True),
        Parameter("q1", "1", lower=-4.0, upper=4.0, typical=1.0, may_be_zero=True),
        Parameter("q2", "1", lower=-4.0, upper=4.0, typical=1.0, may_be_zero=True),
    )
    former_shape = (0.0, 0.0, 0.0, 0.0)
    nested_in = "stiffness field"  # nearly: beside fifteen free cosines its place and radius stand in for anything
    decided_by = "the sheet looked at against the light, or a thickness gauge"

    def shape_values(self, data):
        places = (np.asarray(data.centroids) - np.asarray(data.centre)) / float(data.size)
        found = []
        for places_along, radius in GRID:
            step = 1 / places_along
            cells = np.unique(np.floor(places / step).astype(int), axis=0)
            found += [(*((cell + 0.5) * step).tolist(), radius, 0.0, 0.0, 0.0, 0.0) for cell in cells]
        return found

    def located(self, data, shape):
        size = float(data.size)
        x, y = np.asarray(data.centre) + size * np.array(shape[:2])
        long, short, angle = half_axes(*shape[2:5])
        if squareness(np.hypot(*shape[5:])) > CORNERS:
            told = ", ".join(f"({x + size * dx:.3g}, {y + size * dy:.3g})" for dx, dy in corners(shape[2:]))
            return f"within a quadrilateral with corners near {told} mm"
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


def squareness(q: Any) -> Any:
    """Of the outline, from 0 to 1: q where it is small, and no more steep where it ends."""
    return 1 - jnp.maximum(1 - q / SHARP, 0.0) ** 3


def corners(shape: Sequence[float]) -> Array:
    """Places (4, 2) of the outline where it is farthest beyond the ellipse of its axes, from its middle, in the unit of the radius. shape: radius, e1, e2, q1, q2."""
    radius, e1, e2, q1, q2 = shape
    angles = (np.arctan2(q2, q1) + np.pi * np.array([1.0, 3.0, 5.0, 7.0])) / 4
    round_places = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    reach = radius * np.exp(float(_outline(jnp.asarray(round_places[:1]), q1, q2)[0][0]))
    return np.asarray(reach * round_places @ np.asarray(_stretch(-e1, -e2)))


def _depth(place: Any, shape: Any) -> Any:
    """Distance (m,) of places (m, 2), from the middle, to the outline, positive within; to first order: exact of a circle and at the outline, too deep inside a flat ellipse near its tips."""
    radius, e1, e2, q1, q2 = shape
    to_round = _stretch(e1, e2)
    y = place @ to_round
    squared = (y**2).sum(axis=1) + 1e-18
    reach, growth = _outline(y, q1, q2)
    share = jnp.sqrt(squared) * jnp.exp(-reach) / radius  # of the way from the middle to the outline
    slope = (y - growth[:, None] * jnp.stack([-y[:, 1], y[:, 0]], axis=1)) @ to_round
    return (1 - share) * squared / (share * jnp.sqrt((slope**2).sum(axis=1) + 1e-18))


def _stretch(e1: Any, e2: Any) -> Any:
    """Matrix (2, 2), symmetric, that makes the ellipse a circle of the same area."""
    squared = e1**2 + e2**2
    e = jnp.sqrt(jnp.where(squared > ROUND, squared, 1.0))
    along = jnp.where(squared > ROUND, jnp.cosh(e), 1 + squared / 2)
    across = jnp.where(squared > ROUND, jnp.sinh(e) / e, 1 + squared / 6)
    return jnp.array([[along - across * e1, -across * e2], [-across * e2, along + across * e1]])


def _outline(y: Any, q1: Any, q2: Any) -> tuple[Any, Any]:
    """Logarithm (m,) of the distance of the outline from the middle towards places y (m, 2), over the radius, and its derivative by the angle.

    x^2 + y^2 - s x^2 y^2 / r^2 = r^2, with s the squareness, solved along a ray; the area is that of the circle for s = 0 and 1, nearly so between.
    """
    squared = q1**2 + q2**2
    q = jnp.sqrt(jnp.where(squared > ROUND, squared, 1.0))
    ratio = jnp.where(squared > ROUND, squareness(q) / q, 1.0)
    square = jnp.where(squared > ROUND, squareness(q), 0.0)
    complex_place = (y[:, 0] + 1j * y[:, 1]) / jnp.sqrt((y**2).sum(axis=1) + 1e-18)
    around = complex_place**4 * ratio * (q1 - 1j * q2)  # s exp(4i (angle - u))
    root = jnp.sqrt(1 - 0.5 * (square - around.real) + CORNER)
    reach = 0.5 * (jnp.log(2 / (1 + root)) - square / 8 - (SQUARE - 1 / 8) * square**4)
    return reach, 0.5 * around.imag / (root * (1 + root))
