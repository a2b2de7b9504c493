"""Noise of a full-field record, estimated from the record itself.

In: points (n, 2) mm and the displacements of all frames (n_frames, n, 2) mm.
Out: standard deviation and correlation length of the displacement error. That of the force: `load_cell_noise`.

A smooth field is taken away at every point by a local cubic fit to its 25 nearest neighbours; what is left,
r = R u with R known, has the covariance R S R^T for an error of covariance S = std^2 exp(-d^2 / (2 l^2)). Its
empirical autocovariance, binned by distance, is fitted with exactly this expression, so that what the filter
removes is accounted for. Two numbers follow:

- total: from the frames themselves; includes errors that persist from frame to frame (a speckle pattern is
  matched with the same error while it deforms slowly) and fine structure of the specimen that no smooth model
  describes. This is what an equilibrium equation sees, and the default. Places at edges, as beside a hole, where the residual stands out of the others are left out.
- temporal: only what changes from one frame to the next. What frames have in common, the loading and whatever bends with it, are the few leading
  principal components of all frames, which stand out of the even rest that noise leaves (as in denoising of images; Veraart, Fieremans and Novikov 2016); the rest, scaled to the full
  number of frames, is the noise. The smooth field taken away is one cubic over all points, so that long correlation lengths stay visible. With fewer than eight frames it is what a frame is off the line between its neighbours,
  ((1 - a) u_(k-1) - u_k + a u_(k+1)) / sqrt(1 + a^2 + (1 - a)^2), with a where on the line it is nearest. That holds motion, as what half of the components leave may: what stands out of the rest
  is no noise, and the local fit is taken away there. The smooth part of what frames are off the line is reported as jitter (vibration, frame timing). Frames in which the motion turns have no line.
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
from calibrate.robust_deviation import robust_std
from meshes.mesh import spacing_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]
NEIGHBOURS, LARGEST_PATCH = 25, 1500
# reach of the covariances of local and overall filter, and length below which noise counts as white, in spacings
NEAR, FAR, WHITE = 6.0, 15.0, 0.3
# mean square of a residual over the usual one, which less than 1 % of noise in common to all frames reaches; spacings
STANDS_OUT, BESIDE = 5.0, 2.5
ONE_SIDED, AT_EDGE = 0.6, 3.0  # spacings: the mean of the neighbours from a point at an edge; from such a point
FEWEST_PLACES = 30
# misfit from which the correlation length of the total is no noise's; that of the temporal noise is taken
UNCLEAR = 0.25
FEWEST_FRAMES = 8  # of which principal components tell noise
LEADING, GAP = 2.5, 2.0  # variance of a component over the median of all; over the next one
ROUNDING = 1e-12  # of the variance of the first component, below which one was taken out


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
    at_edge = _at_edge(points)[patch]
    points, frames = points[patch], displacements[:, patch]
    moving = frames[np.abs(frames).max(axis=(1, 2)) > 0]
    if not len(moving):
        raise errors.ExperimentError(
            "nothing moves in any frame, so that no noise can be estimated; check which columns hold the displacements"
        )
    local, inner = local_residual_operator(points)
    quiet = _quiet(points[inner], np.stack([local @ moving[..., i].T for i in (0, 1)], axis=-1), at_edge[inner])
    local, inner = local[quiet], inner[quiet]
    detail = _Filtered(points, lambda values: local @ values, inner, NEAR)
    total = detail.fit(moving)
    if len(moving) < 5:
        return DisplacementNoise(total, None, float("nan"), detail.scale(moving, total.correlation_length))
    second = off_line(moving)
    new = new_in_each(moving) if len(moving) >= FEWEST_FRAMES else second
    smooth = _cubic(points)
    overall = _Filtered(points, lambda values: values - smooth @ (smooth.T @ values), np.arange(len(points)), FAR)
    temporal = (detail if len(moving) < FEWEST_FRAMES or _stands_out(new) else overall).fit(new)
    jitter = float(np.sqrt(np.mean(np.einsum("np,kni->kpi", smooth, second) ** 2) * smooth.shape[1] / len(points)))
    if total.misfit > UNCLEAR:
        total = detail.fit_at(moving, temporal.correlation_length)
    if temporal.std > total.std:  # its correlation is too long for the local filter
        total = temporal
    return DisplacementNoise(total, temporal, jitter, detail.scale(moving, total.correlation_length))


def off_line(frames: Array) -> Array:
    """(k - 2, n, 2), mm: by how much each of frames (k, n, 2) is off the line between its neighbours, over the standard deviation that noise of 1 mm makes of it; without
    those that lie beyond their neighbours, where the motion turns, if others are left."""
    line, moved = frames[2:] - frames[:-2], frames[1:-1] - frames[:-2]
    size = np.einsum("kni,kni->k", line, line)
    a = np.where(size > 0, np.einsum("kni,kni->k", moved, line) / np.maximum(size, 1e-300), 0.5)
    between = (a > 0) & (a < 1)
    chosen = between if between.any() else np.ones(len(a), bool)
    a = np.clip(a[chosen], 0.0, 1.0)[:, None, None]
    return np.asarray((a * line[chosen] - moved[chosen]) / np.sqrt(1 + a**2 + (1 - a) ** 2))


def new_in_each(frames: Array) -> Array:
    """(k, n, 2), mm: frames (k, n, 2) without their leading principal components, at most half of all, scaled to the variance of noise that is new in each."""
    left, sizes, right = np.linalg.svd(frames.reshape(len(frames), -1), full_matrices=False)
    variances, first = np.maximum(sizes**2, 1e-300), np.arange(len(frames) // 2)
    leading = (variances[first] > LEADING * np.median(variances)) | (variances[first] > GAP * variances[first + 1])
    n = int(np.flatnonzero(leading).max(initial=-1)) + 1
    rest = (left[:, n:] * sizes[n:]) @ right[n:]
    return np.asarray(np.sqrt(len(frames) / (len(frames) - n)) * rest).reshape(frames.shape)


def _stands_out(rest: Array) -> bool:
    """Whether the first principal component of fields (k, n, 2), mm, some of which may have been taken out, stands out of the others."""
    variances = np.linalg.svd(rest.reshape(len(rest), -1), compute_uv=False) ** 2
    variances = variances[variances > ROUNDING * variances[0]]
    return bool(len(variances) and variances[0] > LEADING * np.median(variances))


def _at_edge(points: Array) -> NDArray[np.bool_]:
    """Which of points (n, 2) are at most `AT_EDGE` spacings from one whose neighbours do not surround it."""
    offset = points[cKDTree(points).query(points, k=NEIGHBOURS)[1]].mean(axis=1) - points
    pitch = spacing_of(points)
    edge = points[np.linalg.norm(offset, axis=1) > ONE_SIDED * pitch]
    return np.asarray(cKDTree(edge).query(points)[0] <= AT_EDGE * pitch)


def _quiet(places: Array, residuals: Array, at_edge: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which of places (m, 2) have residuals (m, k, 2) as usual, or are not at an edge (m,), and so have those beside them; all where that leaves too few."""
    usual = robust_std(residuals, axis=(0, 2))
    loud = ((residuals / np.maximum(usual, 1e-300)[:, None]) ** 2).mean(axis=(1, 2)) > STANDS_OUT
    loud &= at_edge
    quiet = ~loud
    if loud.any():
        quiet = cKDTree(places[loud]).query(places)[0] > BESIDE * spacing_of(places)
    return quiet if quiet.sum() >= FEWEST_PLACES else np.ones(len(places), bool)


def local_residual_operator(points: Array, neighbours: int = NEIGHBOURS) -> tuple[sp.csr_array, Index]:
    """R (n_inner, n): value minus local cubic fit, at those of points (n, 2) whose neighbours surround them; and
    which these are (n_inner,).

    Raises `ExperimentError` where less than 30 are.
    """
    pitch = spacing_of(points)
    _, index = cKDTree(points).query(points, k=neighbours)
    offset = (points[index] - points[:, None]) / (2 * pitch)
    inner = np.flatnonzero(np.linalg.norm(offset.mean(axis=1), axis=1) < 0.1)
    if inner.size < FEWEST_PLACES:
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
        """At the correlation length of least misfit."""
        measured = self.empirical(frames)
        bounds = (0.0, 0.5 * self.reach * self.pitch)
        tried = minimize_scalar(
            lambda length: self._at(length, measured).misfit, bounds=bounds, method="bounded",
            options={"xatol": 0.02 * self.pitch},
        )  # fmt: skip
        return self._at(float(tried.x) if tried.x > WHITE * self.pitch else 0.0, measured)

    def fit_at(self, frames: Array, length: float) -> FieldNoise:
        """At a correlation length, mm."""
        return self._at(length, self.empirical(frames))

    def _at(self, length: float, measured: Array) -> FieldNoise:
        if not measured[0] > 0:
            return FieldNoise(0.0, 0.0, 0.0)
        weight, model = np.sqrt(self.counts), self.expected(length)
        variance = float((weight**2 * model) @ measured / ((weight * model) @ (weight * model)))
        misfit = np.linalg.norm(weight * (measured - variance * model)) / np.linalg.norm(weight * measured)
        return FieldNoise(float(np.sqrt(max(variance, 0.0))), length, float(misfit))

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
