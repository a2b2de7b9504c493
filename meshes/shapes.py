"""Planar shapes, mm: corners rounded by arcs, elliptic holes, distance to a polygon."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Corner:
    """Corner of an outline at (x, y), rounded with `radius`, mm."""

    x: float
    y: float
    radius: float = 0.0


@dataclass(frozen=True)
class Ellipse:
    """Hole with centre (x, y) and semi-axes a >= b, mm; `angle` of the long axis to x, rad."""

    x: float
    y: float
    a: float
    b: float
    angle: float = 0.0
    closed: ClassVar[bool] = True

    @property
    def area(self) -> float:
        """Area pi a b, mm^2."""
        return math.pi * self.a * self.b

    @property
    def tip_radius(self) -> float:
        """Smallest radius of curvature b^2 / a, mm."""
        return self.b**2 / self.a

    def level(self, points: Array) -> Array:
        """(n,): 1 on the rim, smaller inside, for points (n, 2)."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        x, y = points[:, 0] - self.x, points[:, 1] - self.y
        return np.hypot((c * x + s * y) / self.a, (c * y - s * x) / self.b)

    def rim(self, n: int = 90) -> Array:
        """(n, 2) points on the rim, mm."""
        return self.along(np.linspace(0, 1, n, endpoint=not self.closed))

    def along(self, shares: Array) -> Array:
        """(k, 2) points on the rim, mm, at shares (k,), from 0 to 1, of the way around."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        turns = self._turns(shares)
        x, y = self.a * np.cos(turns), self.b * np.sin(turns)
        return np.column_stack([self.x + c * x - s * y, self.y + s * x + c * y])

    def _turns(self, shares: Array) -> Array:
        return 2 * np.pi * shares

    def cuts(self, points: Array) -> NDArray[np.bool_]:
        """Whether points (n, 2) are where nothing is left."""
        return self.level(points) < 1


@dataclass(frozen=True)
class Arc(Ellipse):
    """Part of an ellipse that is cut out of a sheet at its outline, as fillets and notches are: from parameter `first` to `last`, rad, anticlockwise."""

    first: float = 0.0
    last: float = 2 * math.pi
    closed: ClassVar[bool] = False

    def _turns(self, shares: Array) -> Array:
        return self.first + shares * (self.last - self.first)

    def cuts(self, points: Array) -> NDArray[np.bool_]:
        """Inside, and between the rays from the centre through both ends."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        x, y = points[:, 0] - self.x, points[:, 1] - self.y
        turn = np.arctan2((c * y - s * x) / self.b, (c * x + s * y) / self.a)
        return (self.level(points) < 1) & ((turn - self.first) % (2 * math.pi) <= self.last - self.first)


@dataclass(frozen=True)
class Segment:
    """Straight edge from `start` to `end`, mm, of a sheet on its left."""

    start: tuple[float, float]
    end: tuple[float, float]
    closed: ClassVar[bool] = False

    @property
    def x(self) -> float:
        """Of its middle, mm."""
        return (self.start[0] + self.end[0]) / 2

    @property
    def y(self) -> float:
        """Of its middle, mm."""
        return (self.start[1] + self.end[1]) / 2

    def rim(self, n: int = 90) -> Array:
        """(n, 2) points on the edge, both ends among them, mm."""
        return self.along(np.linspace(0, 1, n))

    def along(self, shares: Array) -> Array:
        """(k, 2) points on the edge, mm, at shares (k,), from 0 to 1, of its length."""
        return np.array(self.start) + shares[:, None] * np.subtract(self.end, self.start)

    def cuts(self, points: Array) -> NDArray[np.bool_]:
        """Whether points (n, 2) are beside the edge, where nothing is."""
        way = np.subtract(self.end, self.start)
        from_start = points - self.start
        share = from_start @ way / (way @ way)
        return (way[0] * from_start[:, 1] - way[1] * from_start[:, 0] < 0) & (share >= 0) & (share <= 1)


type Rim = Ellipse | Segment


def rotations(quadrant: list[Corner]) -> list[Corner]:
    """A list of corners and its copies turned by 90, 180 and 270 degrees."""
    turned = list(quadrant)
    for _ in range(3):
        quadrant = [Corner(-c.y, c.x, c.radius) for c in quadrant]
        turned += quadrant
    return turned


def triples(corners: list[Corner]) -> Iterator[tuple[Corner, Corner, Corner]]:
    """Each corner with its neighbours."""
    return zip(corners[-1:] + corners[:-1], corners, corners[1:] + corners[:1], strict=True)


def distance(one: Corner, other: Corner) -> float:
    """Between two corners, mm."""
    return math.hypot(other.x - one.x, other.y - one.y)


def turn_angle(before: Corner, corner: Corner, after: Corner) -> float:
    """Change of direction at a corner, rad: positive at a convex one of an anticlockwise outline."""
    a = math.atan2(corner.y - before.y, corner.x - before.x)
    b = math.atan2(after.y - corner.y, after.x - corner.x)
    return (b - a + math.pi) % (2 * math.pi) - math.pi


def fillet_arc(before: Corner, corner: Corner, after: Corner) -> tuple[Array, Array, Array]:
    """Start, centre and end (2,) of the arc that rounds a corner, mm."""
    turn = turn_angle(before, corner, after)
    at = np.array([corner.x, corner.y])
    inward = np.array([before.x, before.y]) - at
    outward = np.array([after.x, after.y]) - at
    inward, outward = inward / np.linalg.norm(inward), outward / np.linalg.norm(outward)
    tangent = corner.radius * abs(math.tan(turn / 2))
    bisector = (inward + outward) / np.linalg.norm(inward + outward)
    centre = at + bisector * corner.radius / math.cos(turn / 2)
    return at + tangent * inward, centre, at + tangent * outward


def fillet_points(before: Corner, corner: Corner, after: Corner, n: int = 17) -> Array:
    """`n` points (n, 2) on the arc that rounds a corner, mm, both its ends among them."""
    start, centre, _ = fillet_arc(before, corner, after)
    angles = np.linspace(0, turn_angle(before, corner, after), n)
    x, y = start - centre
    c, s = np.cos(angles), np.sin(angles)
    return centre + np.column_stack([c * x - s * y, s * x + c * y])


def polygon_area(polygon: Array) -> float:
    """Area of a closed polygon (m, 2), mm^2, negative where it runs clockwise."""
    x, y = polygon.T
    return 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def signed_distance(points: Array, polygon: Array) -> Array:
    """Distance (n,) of points (n, 2) to a polygon (m, 2), negative outside, mm."""
    a, b = polygon, np.roll(polygon, -1, axis=0)
    edge, offset = b - a, points[:, None] - a
    t = np.clip((offset * edge).sum(-1) / (edge**2).sum(-1), 0, 1)
    distance = np.linalg.norm(offset - t[..., None] * edge, axis=-1).min(axis=1)
    crosses = (a[:, 1] > points[:, None, 1]) != (b[:, 1] > points[:, None, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        x = a[:, 0] + edge[:, 0] * offset[..., 1] / edge[:, 1]
    inside = (crosses & (points[:, None, 0] < x)).sum(axis=1) % 2 == 1
    return np.where(inside, distance, -distance)
