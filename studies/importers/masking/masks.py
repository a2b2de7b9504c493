"""Points that are left out of an import before it is triangulated: named, in boxes or circles, near a side, spurious.

In: points and a `Mask`, all in mm of the imported frame (y up). Out: which points go, by reason. Edges are found on what is left, so
that a loaded edge moves inwards with the points that go.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibrate import errors
from meshes.mesh import spacing_of
from studies.importers.masking.outliers import outliers

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
SIDES: dict[str, tuple[int, int]] = {"left": (0, -1), "right": (0, 1), "bottom": (1, -1), "top": (1, 1)}
ROUND = 8  # neighbours of a point
NEAR = 0.6  # of the distance of the points, within which a named place is a point


@dataclass(frozen=True)
class Mask:
    """points: places (x, y); boxes: (x0, y0, x1, y1); circles: (x, y, radius), mm. drop_mm, drop_points: by side, how far inwards, or
    how many rows of points. outliers: whether spurious points go."""

    points: Sequence[tuple[float, float]] = ()
    boxes: Sequence[tuple[float, float, float, float]] = ()
    circles: Sequence[tuple[float, float, float]] = ()
    drop_mm: Mapping[str, float] = field(default_factory=dict)
    drop_points: Mapping[str, int] = field(default_factory=dict)
    outliers: bool = True


@dataclass(frozen=True, eq=False)
class Masked:
    """named (n,): points that the mask names, or that lie near a side; spurious (n,): those found by the test of `outliers`. removed:
    whether the latter go, too."""

    named: Flags
    spurious: Flags
    removed: bool

    @property
    def gone(self) -> Flags:
        """All that are left out (n,)."""
        return self.named | self.spurious if self.removed else self.named

    def lone(self, points: Array) -> Flags:
        """Spurious points (n,) that go, all of whose neighbours among points (n, 2) stay: material goes on there, as it may not where many go, in a hole."""
        going = np.flatnonzero(self.spurious if self.removed else np.zeros_like(self.named))
        found = np.zeros(len(points), bool)
        near = cKDTree(points).query(points[going], k=min(ROUND + 1, len(points)))[1]
        found[going] = self.gone[near].sum(axis=1) == 1
        return found & ~self.named

    def to_dict(self, points: Array) -> dict[str, Any]:
        """For a provenance: how many, and where the spurious ones are, mm."""
        return {
            "named": int(self.named.sum()),
            "spurious": points[self.spurious].round(4).tolist(),
            "spurious_removed": self.removed,
        }


def masked(points: Array, displacements: Array, mask: Mask, flagged: Flags | None = None) -> Masked:
    """What goes of points (n, 2) mm with displacements (n_frames, n, 2) mm; flagged (n,): by a column of the tables.

    Raises `ConfigError` for a place without a point, or where nothing would be left.
    """
    named = np.zeros(len(points), bool) if flagged is None else flagged.copy()
    x, y = points.T
    named |= _at_places(points, mask.points)
    for x0, y0, x1, y1 in mask.boxes:
        named |= (x >= min(x0, x1)) & (x <= max(x0, x1)) & (y >= min(y0, y1)) & (y <= max(y0, y1))
    for cx, cy, radius in mask.circles:
        named |= np.hypot(x - cx, y - cy) <= radius
    for side, depth in mask.drop_mm.items():
        named |= inwards(points, side) < depth
    for side, count in mask.drop_points.items():
        named |= _rows(inwards(points, side), spacing_of(points)) < count
    if (~named).sum() < 4:
        raise errors.ConfigError(
            f"[mask] and [edges] leave {int((~named).sum())} of {len(points)} points; make them smaller"
        )
    spurious = np.zeros(len(points), bool)
    spurious[np.flatnonzero(~named)[outliers(points[~named], displacements[:, ~named]).index]] = True
    return Masked(named, spurious, mask.outliers)


def _at_places(points: Array, places: Sequence[tuple[float, float]]) -> Flags:
    """Points nearest to places. Raises `ConfigError` where none is near."""
    found = np.zeros(len(points), bool)
    reach = NEAR * spacing_of(points)
    for place in places:
        distance, index = cKDTree(points).query(place)
        if distance > reach:
            near = points[index]
            raise errors.ConfigError(
                f"mask.points: no point at ({place[0]:g}, {place[1]:g}) mm; the nearest is at ({near[0]:.4g}, {near[1]:.4g}) mm"
            )
        found[index] = True
    return found


def inwards(points: Array, side: str) -> Array:
    """Distance (n,) of every point from the outermost one of a side, mm."""
    axis, sign = SIDES[side]
    value = sign * points[:, axis]
    return np.asarray(value.max() - value)


def _rows(distance: Array, pitch: float) -> NDArray[np.int64]:
    """Row (n,) of every point, counted from the side; rows are half a distance of points apart at least."""
    order = np.argsort(distance)
    steps = np.concatenate([[0], np.cumsum(np.diff(distance[order]) > 0.5 * pitch)])
    result = np.empty(len(distance), np.int64)
    result[order] = steps
    return result
