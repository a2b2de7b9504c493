"""The plane of a specimen seen by two cameras: stereo points in, coordinates in that plane and normal to it out.

The plane is that of least squares through the reference points (smallest singular vector). Its x-axis is the one nearest to the x-axis of
the export, so that 'left' and 'top' keep their meaning.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate import errors

Array = NDArray[np.float64]
STEEP = 0.3  # cosine of the normal with z, below which x and y of the export say nothing of the specimen


@dataclass(frozen=True, eq=False)
class Plane:
    """origin (3,) mm; axes (3, 3): rows are the unit vectors along, across and normal; warp: rms distance of the reference points, mm."""

    origin: Array
    axes: Array
    warp: float

    @property
    def tilt(self) -> float:
        """Angle between its normal and z of the export, degrees."""
        return float(np.degrees(np.arccos(min(1.0, abs(self.axes[2, 2])))))

    def components(self, vectors: Array) -> Array:
        """Vectors (..., 3) along, across and normal."""
        return vectors @ self.axes.T

    def coordinates(self, points: Array) -> Array:
        """Coordinates (..., 2) in the plane of points (..., 3), mm; its origin keeps the x and y of the export."""
        return self.components(points - self.origin)[..., :2] + self.origin[:2]

    def to_dict(self) -> dict[str, Any]:
        """For a provenance."""
        return {"tilt_degrees": self.tilt, "warp_rms_mm": self.warp, "normal": self.axes[2].tolist()}


def fitted_plane(points: Array) -> Plane:
    """Through points (n, 3), mm. Raises `ExperimentError` where x and y of the export do not lie in it."""
    origin = points.mean(axis=0)
    normal = np.linalg.svd(points - origin, full_matrices=False)[2][2]
    normal = normal if normal[2] >= 0 else -normal
    if normal[2] < STEEP:
        raise errors.ExperimentError(
            f"the plane of the specimen is tilted by {np.degrees(np.arccos(normal[2])):.0f} degrees against x and y of the export; "
            "align the coordinate system in the DIC program"
        )
    along = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
    along /= np.linalg.norm(along)
    axes = np.stack([along, np.cross(normal, along), normal])
    return Plane(origin, axes, float(np.sqrt(np.mean(((points - origin) @ normal) ** 2))))
