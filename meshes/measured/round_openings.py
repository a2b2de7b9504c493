"""Round holes that a grid of points left open: the points around an opening in, the largest circle or ellipse between them out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from meshes.measured.unseen_rims import distance_beyond
from meshes.shapes import Ellipse

Array = NDArray[np.float64]
RAGGED = 0.5  # of the mean turn of a polygon, that a turn differs from those beside it in a staircase
# in distances of the points: half an axis of a hole that is fitted, at least; how far nine of ten points around an opening are beyond it, and all
SMALLEST, CLOSE, CLOSE_ALL = 1.5, 1.0, 1.6
OFF_CENTRE = (
    0.5  # of the mean distance of the points around an opening from their middle, by which that of the hole may differ
)
WIDEST = 1.6  # logarithm of the ratio of axes


def is_staircase(polygon: Array) -> bool:
    """Whether a closed polygon (k, 2) turns here and there, as the points of a grid around a round hole do, and not everywhere alike, as points on its rim do."""
    along = np.roll(polygon, -1, axis=0) - polygon
    after = np.roll(along, -1, axis=0)
    turns = np.arctan2(along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0], (along * after).sum(axis=1))
    beside = (np.roll(turns, 1) + np.roll(turns, -1)) / 2
    return float(np.abs(turns - beside).mean()) > RAGGED * 2 * np.pi / len(turns)


def fitted_hole(opening: Array, pitch: float) -> Ellipse | None:
    """The largest circle between the points (k, 2), mm, around an opening that a grid of distance `pitch` left of a round hole, or the largest ellipse; None where it is too small, or neither
    comes near enough to all of them."""
    middle = opening.mean(axis=0)
    size = float(np.linalg.norm(opening - middle, axis=1).mean())
    places = (opening - middle) / size
    for start in [(0.0, 0.0), *((0.0, 0.0, 0.3, angle) for angle in np.arange(4) * np.pi / 4)]:
        best = minimize(lambda p: -_largest(p, places).area, start, method="Nelder-Mead", options={"maxiter": 2000})
        one = _largest(best.x, places)
        x, y = (middle + size * np.array([one.x, one.y])).tolist()
        found = Ellipse(x, y, size * one.a, size * one.b, one.angle)
        if _is_close(found, opening, pitch):
            return found
    return None


def _largest(shape: Array, places: Array) -> Ellipse:
    """The circle of a middle (x, y), near that of the places (k, 2), or the ellipse of (x, y, logarithm of the ratio of its axes, angle), that fits between the places."""
    x, y = np.clip(shape[:2], -OFF_CENTRE, OFF_CENTRE).tolist()
    ratio, angle = np.clip(shape[2:], [-WIDEST, -np.inf], [WIDEST, np.inf]).tolist() if len(shape) > 2 else (0.0, 0.0)
    a, b, angle = math.exp(abs(ratio) / 2), math.exp(-abs(ratio) / 2), angle + (math.pi / 2 if ratio < 0 else 0.0)
    level = float(Ellipse(x, y, a, b, angle).level(places).min())
    return Ellipse(x, y, a * level, b * level, (angle + math.pi / 2) % math.pi - math.pi / 2)


def _is_close(hole: Ellipse, opening: Array, pitch: float) -> bool:
    if hole.b < SMALLEST * pitch:
        return False
    beyond = distance_beyond(hole, opening)
    return float(np.quantile(beyond, 0.9)) < CLOSE * pitch and float(beyond.max()) < CLOSE_ALL * pitch
