"""Points of a grip that failed: they move as those beside them on the grip do.

In: points, displacements of all frames, and the nodes of each grip. Out: the displacements with these replaced, and how many were.

A clamped edge moves as one body, so that along it a straight line between the nearest points that did not fail tells where the others are; beyond the last of them the motion of that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
MOST = 0.5  # of the points of a grip, that may have failed in a frame


def along_grips(points: Array, displacements: Array, grips: Sequence[tuple[Index, int]]) -> tuple[Array, int]:
    """points (n, 2), displacements (n_frames, n, 2), mm, NaN where a point failed. grips: nodes (k,) and the axis, 0 or 1, along the edge. Frames in which more than
    half of a grip failed stay as they are there."""
    made, count = displacements.copy(), 0
    for nodes, axis in grips:
        order = nodes[np.argsort(points[nodes, axis])]
        at = points[order, axis]
        failed = ~np.isfinite(displacements[:, order]).all(axis=2)
        for frame in np.flatnonzero(failed.any(axis=1) & (failed.mean(axis=1) <= MOST)):
            bad = failed[frame]
            for i in range(2):
                made[frame, order[bad], i] = np.interp(at[bad], at[~bad], displacements[frame, order[~bad], i])
            count += int(bad.sum())
    return made, count
