"""Noise floor of pictures taken before the loading: displacements of static frames in, their scatter out.

A linear field (rigid motion, and what little uniform strain there is) is taken away from each frame. What is left has a part that stays
from frame to frame, the fixed pattern, and one that changes. With k frames the mean of the changing part, variance / k, is subtracted
from that of the fixed pattern.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STILL = 1e-4  # mean strain, below which a frame before the loading counts as static


@dataclass(frozen=True)
class NoiseFloor:
    """frames: how many. displacement_std, fixed_pattern_std: mm per component; strain_std: of the triangles, per component."""

    frames: int
    displacement_std: float
    fixed_pattern_std: float
    strain_std: float

    def to_dict(self) -> dict[str, Any]:
        """By name."""
        return asdict(self)


def static_count(points: Array, displacements: Array) -> int:
    """How many frames follow the reference without a mean strain. displacements (n_frames, n, 2), mm, the reference first."""
    for k, u in enumerate(displacements[1:]):
        if not np.isfinite(u).all(axis=1).sum() > 3 or np.abs(_linear(points, u)[1]).max() > STILL:
            return k
    return len(displacements) - 1


def noise_floor(points: Array, triangles: NDArray[np.int64], displacements: Array) -> NoiseFloor | None:
    """Of static frames (k, n, 2), mm; None for fewer than two, or where too many points failed in them."""
    good = np.isfinite(displacements).all(axis=(0, 2))
    if len(displacements) < 2 or good.mean() < 0.8:
        return None
    rest = np.stack([_linear(points[good], u[good])[0] for u in displacements])
    changing = rest - rest.mean(axis=0)
    k = len(rest)
    temporal = float((changing**2).sum() / ((k - 1) * changing[0].size))
    fixed = max(float((rest.mean(axis=0) ** 2).mean()) - temporal / k, 0.0)
    number = np.full(len(points), -1)
    number[good] = np.arange(good.sum())
    inside = number[triangles[good[triangles].all(axis=1)]]
    return NoiseFloor(
        k, float(np.sqrt(temporal + fixed)), float(np.sqrt(fixed)), _strain_std(points[good], inside, rest)
    )


def _linear(points: Array, u: Array) -> tuple[Array, Array]:
    """What a linear field leaves of u (n, 2), and the symmetric part of its gradient (2, 2); NaN are kept."""
    known = np.isfinite(u).all(axis=1)
    design = np.column_stack([np.ones(len(points)), points - points.mean(axis=0)])
    fit, *_ = np.linalg.lstsq(design[known], u[known], rcond=None)
    gradient = fit[1:].T
    return u - design @ fit, 0.5 * (gradient + gradient.T)


def _strain_std(points: Array, triangles: NDArray[np.int64], rest: Array) -> float:
    """Root mean square of the normal strains of triangles (m, 3) in frames (k, n, 2)."""
    if not len(triangles):
        return float("nan")
    corners = points[triangles]
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)
    moved = rest[:, triangles]
    change = np.stack([moved[:, :, 1] - moved[:, :, 0], moved[:, :, 2] - moved[:, :, 0]], axis=-1)
    gradient = change @ np.linalg.inv(edges)
    return float(np.sqrt(np.mean(np.diagonal(gradient, axis1=-2, axis2=-1) ** 2)))
