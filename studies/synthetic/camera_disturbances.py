"""What a camera gets wrong: its lens, its distance, its angle and its scale.

In: an exact solution and a mesh of the camera. Out: small classes with their amplitudes, see `studies.synthetic.disturbances`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from studies.synthetic.disturbances import Disturbance


@dataclass(frozen=True)
class LensDistortion(Disturbance):
    """A point at x from the middle is seen at c + (x - c) (1 + k |x - c|^2 / R^2), R half the extent, in every picture.

    x, y: of the centre of distortion c, in extents, from the middle of the specimen.
    """

    k: float
    x: float = 0.0
    y: float = 0.0
    name: ClassVar[str] = "lens distortion"

    def see(self, x, share, size):
        radius = 0.5 * size
        from_centre = x - size * np.array([self.x, self.y])
        return x + from_centre * self.k * (from_centre**2).sum(axis=-1, keepdims=True) / radius**2


@dataclass(frozen=True)
class Tilt(Disturbance):
    """A pinhole camera that is not perpendicular to the sheet: a point at x from the middle is seen at x / (1 + t . x / R), R half the extent, in every picture."""

    tx: float
    ty: float
    name: ClassVar[str] = "camera tilt"

    def see(self, x, share, size):
        return x / (1 + x @ np.array([self.tx, self.ty]) / (0.5 * size))[..., None]


@dataclass(frozen=True)
class OutOfPlane(Disturbance):
    """The specimen comes nearer as it is loaded: the picture grows by m at the largest load."""

    m: float
    name: ClassVar[str] = "out-of-plane motion"

    def see(self, x, share, size):
        return x * (1 + self.m * share.loading)


@dataclass(frozen=True)
class MagnificationDrift(Disturbance):
    """The picture grows in proportion to time, by m at the end."""

    m: float
    name: ClassVar[str] = "magnification drift"

    def see(self, x, share, size):
        return x * (1 + self.m * share.time)


@dataclass(frozen=True)
class Rotation(Disturbance):
    """The camera is turned against the load axes, so that it sees everything turned by phi, rad."""

    phi: float
    name: ClassVar[str] = "image rotation"

    def see(self, x, share, size):
        c, s = np.cos(self.phi), np.sin(self.phi)
        return x @ np.array([[c, s], [-s, c]])


@dataclass(frozen=True)
class Scale(Disturbance):
    """Lengths in the picture are too large by the factor 1 + e."""

    e: float
    name: ClassVar[str] = "DIC scale"

    def see(self, x, share, size):
        return x * (1 + self.e)
