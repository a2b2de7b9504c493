"""Noise of a full-field record, estimated from the record itself.

In: points (n, 2) mm and the displacements of all frames (n_frames, n, 2) mm.
Out: standard deviation and correlation length of the displacement error. That of the force: `load_cell_noise`.

A smooth field is taken away at every point by a local cubic fit to its 25 nearest neighbours; what is left,
r = R u with R known, has the covariance R S R^T for an error of covariance S = std^2 exp(-d^2 / (2 l^2)). Its
empirical autocovariance, binned by distance, is fitted with exactly this expression, so that what the filter
removes is accounted for. Two numbers follow:

- total: from the frames themselves; includes errors that persist from frame to frame (a speckle pattern is
  matched with the same error while it deforms slowly) and fine structure of the specimen that no smooth model
  describes. This is what an equilibrium equation sees, and the default.
- temporal: from what a frame is off the line between its neighbours, ((1 - a) u_(k-1) - u_k + a u_(k+1)) / sqrt(1 + a^2 + (1 - a)^2), with a where on
  the line it is nearest: frames need not be evenly spaced; only what changes from one frame to the next. The smooth field taken away is one cubic over all points, so that long correlation lengths
  stay visible; it is reported as jitter (vibration, frame timing).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from calibrate import errors
from meshes.mesh import spacing_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]
NEIGHBOURS, LARGEST_PATCH = 25, 1500
# reach of the covariances of local and overall filter, and length below which noise counts as white, in spacings
NEAR, FAR, WHITE = 6.0, 15.0, 0.3


@dataclass(frozen=True)
class FieldNoise:
    """std, mm, per component; correlation_length l, mm, of std^2 exp(-d^2 / (2 l^2)); misfit: relative, of the fit."""

    std: float
    correlation_length: float
    misfit: float


@dataclass(frozen=True)
class DisplacementNoise:
    """total, temporal: see the module. jitter, mm: smooth motion from frame to frame, NaN where temporal is None.

    frame_std (k,), mm: total std of each frame but those that are zero everywhere, at the common correlation length.
    """

    total: FieldNoise
    temporal: FieldNoise | None
    jitter: float
    frame_std: Array

    def to_dict(self) -> dict[str, Any]:
        """By name, mm, for a provenance; of frame_std the first and the last."""
        return {
            "total": asdict(self.total),
            "temporal": None if self.temporal is None else asdict(self.temporal),
            "jitter_mm": self.jitter,
            "total_std_first_and_last_frames_mm": [float(self.frame_std[0]), float(self.frame_std[-1])],
        }


def displacement_noise(points: Array, displacements: Array) -> DisplacementNoise:
    """Estimate the displacement noise of points (n, 2) and displacements (n_frames, n, 2), both mm, no NaN.

    A frame that is zero everywhere (the reference) is left out of the total. With fewer than five
    others temporal is None. Raises `ExperimentError` with fewer than 100 points, points too scattered, or where nothing moves.
    """
    if len(points) < 100:
        raise errors.ExperimentError(
            f"{len(points)} points are too few to estimate noise from (100 needed); state the noise instead"
        )
    patch = _patch(points)
    points, frames = points[patch], displacements[:, patch]
    moving = frames[np.abs(frames).max(axis=(1, 2)) > 0]
    if not len(moving):
        raise errors.ExperimentError(
            "nothing moves in any frame, so that no noise can be estimated; check which columns hold the displacements"
        )
    local, inner = local_residual_operator(points)
    detail = _Filtered(points, lambda values: local @ values, inner, NEAR)
    total = detail.fit(moving)
    if len(moving) < 5:
        return DisplacementNoise(total, None, float("nan"), detail.scale(moving, total.correlation_length))
    second = off_line(moving)
    smooth = _cubic(points)
    overall = _Filtered(points, lambda values: values - smooth @ (smooth.T @ values), np.arange(len(points)), FAR)
    temporal = overall.fit(second)
    jitter = float(np.sqrt(np.mean(np.einsum("np,kni->kpi", smooth, second) ** 2) * smooth.shape[1] / len(points)))
    if temporal.std > total.std:  # its correlation is too long for the local filter
        total = temporal
    return DisplacementNoise(total, temporal, jitter, detail.scale(moving, total.correlation_length))


def off_line(frames: Array) -> Array:
    """(k - 2, n, 2), mm: by how much each of frames (k, n, 2) is off the line between its neighbours, over the standard deviation that noise of 1 mm makes of it."""
    line, moved = frames[2:] - frames[:-2], frames[1:-1] - frames[:-2]
    size = np.einsum("kni,kni->k", line, line)
    a = np.where(size > 0, np.einsum("kni,kni->k", moved, line) / np.maximum(size, 1e-300), 0.5)
    a = np.clip(a, 0.0, 1.0)[:, None, None]
    return np.asarray((a * line - moved) / np.sqrt(1 + a**2 + (1 - a) ** 2))


def local_residual_operator(points: Array, neighbours: int = NEIGHBOURS) -> tuple[sp.csr_array, Index]:
    """R (n_inner, n): value minus local cubic fit, at those of points (n, 2) whose neighbours surround them; and
    which these are (n_inner,).

    Raises `ExperimentError` where less than 30 are.
    """
    pitch = spacing_of(points)
    _, index = cKDTree(points).query(points, k=neighbours)
    offset = (points[index] - points[:, None]) / (2 * pitch)
    inner = np.flatnonzero(np.linalg.norm(offset.mean(axis=1), axis=1) < 0.1)
    if inner.size < 30:
        raise errors.ExperimentError("the points are too scattered to estimate noise from; state the noise instead")
    x, y = offset[inner, :, 0], offset[inner, :, 1]
    powers = [x**i * y**j for i in range(4) for j in range(4 - i)]
    # weight of each neighbour in the fitted value at the point itself: first row of the pseudo-inverse
    fit = np.linalg.pinv(np.stack(powers, axis=-1))[:, 0]
    rows = np.repeat(np.arange(inner.size), neighbours)
    smooth = sp.csr_array((fit.ravel(), (rows, index[inner].ravel())), shape=(inner.size, len(points)))
    pick = sp.csr_array((np.ones(inner.size), (np.arange(inner.size), inner)), shape=smooth.shape)
    return sp.csr_array(pick - smooth), inner


class _Filtered:
    """Autocovariance of filtered fields, empirical and expected, binned by distance up to `reach` spacings.

    apply: the linear filter, (n, k) to (m, k); places (m,): nodes at which its results are.
    """

    def __init__(self, points: Array, apply: Callable[[Array], Array], places: Index, reach: float):
        self.apply, self.reach = apply, reach
        self.pitch = spacing_of(points)
        self.distances = cdist(points, points)
        distance = self.distances[np.ix_(places, places)] / self.pitch
        self.near = np.nonzero(distance < reach)
        self.bins = np.rint(2 * distance[self.near]).astype(int)
        self.counts = np.maximum(np.bincount(self.bins), 1)

    def _binned(self, covariance: Array) -> Array:
        return np.bincount(self.bins, covariance[self.near]) / self.counts

    def empirical(self, frames: Array) -> Array:
        r = np.concatenate([self.apply(frames[..., i].T) for i in (0, 1)], axis=1)
        return self._binned(r @ r.T / r.shape[1])

    def expected(self, length: float) -> Array:
        """For unit std; `length` mm."""
        ratio = self.distances / max(length, 1e-3 * self.pitch)
        covariance = np.exp(-0.5 * ratio**2)
        return self._binned(self.apply(self.apply(covariance).T))

    def fit(self, frames: Array) -> FieldNoise:
        measured, weight = self.empirical(frames), np.sqrt(self.counts)

        def misfit(length: float) -> float:
            model = self.expected(length)
            scale = (weight * model) @ (weight * measured) / ((weight * model) @ (weight * model))
            return float(np.linalg.norm(weight * (measured - scale * model)) / np.linalg.norm(weight * measured))

        if not measured[0] > 0:
            return FieldNoise(0.0, 0.0, 0.0)
        bounds = (0.0, 0.5 * self.reach * self.pitch)
        found = minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 0.02 * self.pitch})
        length = float(found.x) if found.x > WHITE * self.pitch else 0.0
        model = self.expected(length)
        variance = float((weight**2 * model) @ measured / ((weight**2 * model) @ model))
        return FieldNoise(float(np.sqrt(max(variance, 0.0))), length, misfit(length))

    def scale(self, frames: Array, length: float) -> Array:
        """Std of each frame (n_frames,), mm, at a given correlation length."""
        unit = self.expected(length)[0]
        r = np.stack([self.apply(frames[..., i].T) for i in (0, 1)])
        return np.sqrt((r**2).mean(axis=(0, 1)) / unit)


def _patch(points: Array) -> NDArray[np.int64]:
    """The points nearest to the centre, at most LARGEST_PATCH of them."""
    distance = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    return np.sort(np.argsort(distance, kind="stable")[:LARGEST_PATCH])


def _cubic(points: Array) -> Array:
    """Orthonormal cubic polynomials (n, 10) at points (n, 2)."""
    x, y = ((points - points.mean(axis=0)) / np.ptp(points, axis=0).max()).T
    return np.linalg.qr(np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=1))[0]
