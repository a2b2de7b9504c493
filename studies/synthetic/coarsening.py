"""Coarser measurements: an Experiment on a fine triangulation in, the same on a coarser one out.

The displacements are projected: the coarse piecewise-linear field is the closest to the fine one in L2,

    integral (u_coarse - u_fine)^2 dA -> min,

with quadrature on the fine triangles. Where the fine triangulation reaches beyond the coarse one (slivers at
curved edges) the nearest coarse triangle is extrapolated. Noise is projected with everything else, on the
boundary as well; what is left of it is measured on projected samples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from matplotlib.tri import Triangulation
from numpy.typing import NDArray
from scipy.optimize import curve_fit
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from calibrate.data.experiment import Experiment, Noise
from calibrate.data.triangulation import boundary_edges, signed_areas
from calibrate.equations import noise_covariance
from calibrate.errors import MeshMismatchError
from meshes import Mesh
from meshes.mesh import spacing_of
from studies.synthetic.camera import boundaries, stream

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
# degree 4 with 6 points: barycentric coordinates (a, a, 1 - 2a) and weights (Dunavant 1985)
RULE = ((0.445948490915965, 0.223381589678011), (0.091576213509771, 0.109951743655322))
SMOOTHING = 1e-11  # relative weight of a graph Laplacian: decides what no data do
SAMPLES = 100


@dataclass(frozen=True, eq=False)
class Coarsening:
    """Projection from one triangulation to a coarser one of the same specimen; `project` applies it.

    project: values (n_fine, k) to (n_coarse, k).
    """

    fine_points: Array
    mesh: Mesh
    project: Callable[[Array], Array]
    identity: bool = False

    def field(self, displacements: Array) -> Array:
        """(n_increments, n_fine, 2) to (n_increments, n_coarse, 2)."""
        n_increments, n, _ = displacements.shape
        flat = np.moveaxis(displacements, 1, 0).reshape(n, -1)
        return np.moveaxis(self.project(flat).reshape(-1, n_increments, 2), 0, 1)

    def noise(self, noise: Noise, seed: int = 0) -> Noise:
        """What the projection makes of displacement `noise`: standard deviation and correlation length, from samples.

        Averages over the specimen: at its edges the projected noise is a little larger.
        """
        if self.identity or not noise.displacement_std > 0:
            return noise
        factor = noise_covariance.factor_of_points(self.fine_points, noise)
        samples = self.project(factor @ stream(seed).standard_normal((factor.shape[1], SAMPLES)))
        std, length = covariance_fit(self.mesh.points, samples, noise.correlation_length)
        return replace(
            noise.scaled(std / noise.displacement_std),
            correlation_length=length,
            second_length=0.0,
            second_share=0.0,
        )

    def apply(self, fine: Experiment) -> Experiment:
        """`fine` on the coarser triangulation, noise included.

        Raises `MeshMismatchError` when `fine` is not on the mesh that this was made for.
        """
        if fine.points.shape != self.fine_points.shape or not np.allclose(fine.points, self.fine_points):
            raise MeshMismatchError(f"'{fine.name}' is not on the fine mesh of this coarsening; make a new one")
        loaded, free = boundaries(self.mesh, {b.name: b.force for b in fine.loaded})
        share = len(self.mesh.points) / len(fine.points)
        return replace(
            fine,
            name=f"{fine.name}, {100 * share:.1f} % of the nodes",
            points=self.mesh.points,
            triangles=self.mesh.cells,
            displacements=self.field(fine.displacements),
            loaded=loaded,
            free_nodes=free,
            noise=None if fine.noise is None else self.noise(fine.noise),
            provenance={
                **fine.provenance,
                "coarsening": {"nodes": len(self.mesh.points), "of": len(fine.points)},
            },
        )


def coarsening(points: Array, triangles: Indices, mesh: Mesh) -> Coarsening:
    """Projection from a triangulation (points (n, 2) mm, triangles (m, 3)) to `mesh`, which may be the same."""
    if len(points) == len(mesh.points) and np.array_equal(points, mesh.points):
        return Coarsening(points, mesh, lambda values: values, identity=True)
    barycentric = np.concatenate([np.roll([a, a, 1 - 2 * a], k) for a, _ in RULE for k in range(3)]).reshape(-1, 3)
    area = signed_areas(points, triangles)
    weights = np.outer(area, np.repeat([w for _, w in RULE], 3)).ravel()
    places = np.einsum("qa,mai->mqi", barycentric, points[triangles]).reshape(-1, 2)
    columns = np.repeat(triangles, len(barycentric), axis=0)
    rows = np.repeat(np.arange(len(places)), 3)
    values = np.tile(barycentric, (len(triangles), 1))
    from_fine = sp.csr_array((values.ravel(), (rows, columns.ravel())), shape=(len(places), len(points)))
    from_coarse = interpolation(mesh.points, mesh.cells, places)
    weighted = sp.csr_array(from_coarse.T @ sp.diags_array(weights))
    gram = weighted @ from_coarse
    solver = splu(sp.csc_array(gram + SMOOTHING * gram.diagonal().mean() * _laplacian(mesh)))
    right = weighted @ from_fine
    return Coarsening(points, mesh, lambda values: solver.solve(np.ascontiguousarray(right @ values)))


def interpolation(points: Array, triangles: Indices, where: Array) -> sp.csr_array:
    """Linear interpolation (k, n) from nodes to places (k, 2); outside, the nearest triangle is extrapolated."""
    owner = np.asarray(Triangulation(points[:, 0], points[:, 1], triangles).get_trifinder()(*where.T), np.int64)
    outside = np.flatnonzero(owner < 0)
    if outside.size:
        owner[outside] = _nearest_triangle(points, triangles, where[outside])
    a, b, c = (points[triangles[owner, i]] for i in range(3))
    local = np.linalg.solve(np.stack([b - a, c - a], axis=-1), (where - a)[..., None])[..., 0]
    weights = np.column_stack([1 - local.sum(axis=1), local])
    rows = np.repeat(np.arange(len(where)), 3)
    return sp.csr_array((weights.ravel(), (rows, triangles[owner].ravel())), shape=(len(where), len(points)))


def _nearest_triangle(points: Array, triangles: Indices, where: Array) -> Indices:
    """Triangle (k,) with the boundary edge nearest to places (k, 2) outside of the mesh."""
    edges, owner = boundary_edges(triangles)
    start, along = points[edges[:, 0]], points[edges[:, 1]] - points[edges[:, 0]]
    nearest = np.empty(len(where), np.int64)
    for k in range(0, len(where), 1000):
        offset = where[k : k + 1000, None] - start
        share = np.clip((offset * along).sum(-1) / (along**2).sum(-1), 0, 1)
        distance = ((offset - share[..., None] * along) ** 2).sum(-1)
        nearest[k : k + 1000] = owner[distance.argmin(axis=1)]
    return nearest


def _laplacian(mesh: Mesh) -> sp.csr_array:
    """Graph Laplacian (n, n) of the mesh's edges, divided by the number of neighbours."""
    n = len(mesh.points)
    edges = np.concatenate([mesh.cells[:, [0, 1]], mesh.cells[:, [1, 2]], mesh.cells[:, [2, 0]]])
    both = np.concatenate([edges, edges[:, ::-1]])
    adjacency = sp.csr_array((np.ones(len(both)), both.T), shape=(n, n))
    adjacency.data[:] = 1.0
    return sp.csr_array(sp.diags_array(adjacency.sum(axis=1)) - adjacency)


def covariance_fit(points: Array, samples: Array, guess: float) -> tuple[float, float]:
    """std and correlation length of std^2 exp(-r^2 / (2 l^2)) that describe samples (n, k) of a zero-mean field.

    std is that of the samples; l is fitted to their correlation at distances below 2.5 `guess` (or 3 point
    spacings). 0 when neighbours are uncorrelated.
    """
    std = float(np.sqrt(np.mean(samples**2)))
    pitch = spacing_of(points)
    reach = max(2.5 * guess, 3 * pitch)
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    if len(pairs) > 200_000:
        pairs = pairs[stream(0).choice(len(pairs), 200_000, replace=False)]
    r = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    correlation = (samples[pairs[:, 0]] * samples[pairs[:, 1]]).mean(axis=1) / std**2
    bins = np.minimum((25 * r / reach).astype(int), 24)
    count = np.bincount(bins, minlength=25)
    filled = count > 0
    mean_r = np.bincount(bins, r, 25)[filled] / count[filled]
    mean_c = np.bincount(bins, correlation, 25)[filled] / count[filled]
    if mean_c[0] < 0.05:
        return std, 0.0
    (length,), _ = curve_fit(
        lambda x, length: np.exp(-0.5 * (x / length) ** 2), mean_r, mean_c, p0=[max(guess, 0.5 * pitch)]
    )
    return std, abs(float(length))
