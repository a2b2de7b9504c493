"""A surface to be turned in a report: points, triangles and a value at each point in; what a page needs to draw it out.

Places are stored to 1 / 65535 of the largest extent and values to 1 / 255 of the range of their colours, so that a
specimen takes some 200 kB. `templates/view.js` draws it.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.output import style

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Signs = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class Scene:
    """points (n, 3), mm; triangles (m, 3) of the skin; values (n,); limits: values at the two ends of the colours.

    mirrors: signs of x, y, z of every image that is drawn. cut: triangles (k, 3) in the plane y = 0, drawn instead of
    the images with y < 0 when the reader cuts the solid open.
    """

    name: str
    points: Array
    triangles: Indices
    values: Array
    limits: tuple[float, float]
    mirrors: tuple[Signs, ...] = ((1, 1, 1),)
    cut: Indices | None = None

    def packed(self) -> dict[str, Any]:
        """The scene as JSON: arrays are base64 of little-endian numbers, places in units of `unit` from `low`."""
        low = self.points.min(axis=0)
        unit = float(np.ptp(self.points, axis=0).max()) / 65535
        shade = np.clip((self.values - self.limits[0]) / (self.limits[1] - self.limits[0]), 0, 1)
        return {
            "name": self.name,
            "points": _base64(np.round((self.points - low) / unit), "<u2"),
            "low": low.tolist(),
            "unit": unit,
            "values": _base64(np.round(255 * shade), "u1"),
            "triangles": _base64(self.triangles, "<u4" if len(self.points) > 65535 else "<u2"),
            "cut": "" if self.cut is None else _base64(self.cut, "<u4" if len(self.points) > 65535 else "<u2"),
            "wide": len(self.points) > 65535,
            "mirrors": self.mirrors,
            "limits": [f"{limit:.3g}" for limit in self.limits],
            "palette": _base64(palette(), "u1"),
        }


def palette() -> NDArray[np.uint8]:
    """(256, 3): the colours of all maps of one sign, which are distinct in grey as well."""
    from matplotlib import colormaps

    return colormaps[style.SEQUENTIAL](np.arange(256), bytes=True)[:, :3]


def joined(triangles: Indices) -> tuple[Indices, Indices]:
    """Only the points that triangles use: their numbers (k,), and the triangles in terms of these."""
    used, renumbered = np.unique(triangles, return_inverse=True)
    return used, renumbered.reshape(triangles.shape)


def _base64(values: Any, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()
