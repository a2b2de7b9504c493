"""Signal to noise of the measured strain: how large it is beside what differs between neighbouring triangles.

In: points, triangles, displacements. Out: `StrainSignal`, of the increment with the largest strain. Medians over the area, so that a
few spurious points do not count. A smooth field has neighbours alike; what differs between them is noise, or structure that no mesh
of this density resolves. Displacements are taken linear in the triangles: nothing is smoothed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrate.data.triangulation import half_edges, signed_areas
from calibrate.robust_deviation import TO_DEVIATION

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class StrainSignal:
    """strain: median norm of the displacement gradient without its rotation, less what noise adds. scatter: standard deviation of the same between a
    triangle and the mean of its neighbours. increment: counted from 0."""

    strain: float
    scatter: float
    increment: int

    @property
    def ratio(self) -> float:
        """Signal to noise of the strain of one triangle; infinite without noise."""
        return self.strain / self.scatter if self.scatter > 0 else float("inf")

    def to_dict(self) -> dict[str, float]:
        """For a provenance or a manifest."""
        return {"strain": self.strain, "scatter": self.scatter, "ratio": self.ratio, "increment": self.increment}


def strain_signal(points: Array, triangles: Indices, displacements: Array) -> StrainSignal:
    """Of points (n, 2) mm, triangles (m, 3) and displacements (t, n, 2) mm."""
    strains = symmetric_gradients(points, triangles, displacements)
    areas = np.abs(signed_areas(points, triangles))
    sizes = np.array([_median(np.linalg.norm(e, axis=1), areas) for e in strains])
    largest = int(np.argmax(sizes))
    one, other = neighbours(triangles)
    count = np.bincount(one, minlength=len(triangles))
    inner = count > 0
    if not inner.any():  # a homogeneous test of one triangle
        return StrainSignal(float(sizes[largest]), 0.0, largest)
    e = strains[largest]
    mean = (
        np.stack([np.bincount(one, e[other, k], len(triangles)) for k in range(3)], axis=1)[inner] / count[inner, None]
    )
    away = np.abs(e[inner] - mean) / np.sqrt(1 + 1 / count[inner, None])
    # each of the three components is a normal number; their sizes add up as squares
    scatter = [TO_DEVIATION * _median(away[:, k], areas[inner]) for k in range(3)]
    noise = float(np.linalg.norm(scatter))
    # noise adds to the size of the measured strain
    return StrainSignal(float(np.sqrt(max(sizes[largest] ** 2 - noise**2, 0.0))), noise, largest)


def symmetric_gradients(points: Array, triangles: Indices, displacements: Array) -> Array:
    """(t, m, 3): xx, yy and sqrt(2) xy of the symmetric part of the displacement gradient in linear triangles."""
    H = displacement_gradients(points, triangles, displacements)
    return np.stack([H[..., 0, 0], H[..., 1, 1], (H[..., 0, 1] + H[..., 1, 0]) / np.sqrt(2)], axis=-1)


def displacement_gradients(points: Array, triangles: Indices, displacements: Array) -> Array:
    """du_i / dX_j (t, m, 2, 2) in linear triangles."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    edges = np.stack([b - a, c - a], axis=1)  # (m, 2, 2): rows
    u = displacements[:, triangles]
    jumps = np.stack([u[:, :, 1] - u[:, :, 0], u[:, :, 2] - u[:, :, 0]], axis=2)  # (t, m, 2, 2): rows along edges
    return np.einsum("mij,tmjk->tmki", np.linalg.inv(edges), jumps)


def neighbours(triangles: Indices) -> tuple[Indices, Indices]:
    """Pairs (k,), (k,) of triangles with an edge in common, each pair in both orders."""
    edges = np.sort(half_edges(triangles), axis=1)
    order = np.lexsort(edges.T)
    same = np.flatnonzero((edges[order[1:]] == edges[order[:-1]]).all(axis=1))
    first, second = order[same] % len(triangles), order[same + 1] % len(triangles)
    return np.concatenate([first, second]), np.concatenate([second, first])


def _median(values: Array, areas: Array) -> float:
    """Median over the area."""
    order = np.argsort(values)
    share = np.cumsum(areas[order])
    return float(values[order[int(np.searchsorted(share, 0.5 * share[-1]))]])
