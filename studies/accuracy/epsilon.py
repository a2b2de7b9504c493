"""How much the surface of a thick specimen deforms otherwise than the thin sheet: two solutions in, epsilon out.

    epsilon = |C_2D - C_3D| / |C_2D|,      C = F^T F,                              Frobenius norm

of the in-plane components of C: those of the 3D solution hold the slope of its surface as well. It is taken at the Gauss
points of the plane mesh, each with its area as weight, because values at nodes and unweighted statistics overstate what
fine meshes near holes show. A percentile here is always one by area. Lengths in mm.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from forward.errors import SolutionError
from forward.solution import SurfaceSolution
from meshes import Cross
from meshes.specimens import Specimen
from studies.output import write_npz

Array = NDArray[np.float64]
NEAR_HOLE = 2.0  # mm from a rim
RIM_POINTS = 180  # of the polygon that stands for a rim in distances: off by about 0.001 mm
SIDES = {"left": (0, -1), "right": (0, 1), "bottom": (1, -1), "top": (1, 1)}


class Solid(Protocol):
    """What is needed of a 3D solution: F (n_inc, k, 3, 3) at surface points (k, 2) with weights (k,), mm^2; time
    (n_inc,): load factor. surface_gauss: points, mm, weights and F."""

    @property
    def time(self) -> Array: ...

    def surface_gauss(self) -> tuple[Array, Array, Array]: ...


@dataclass(frozen=True, eq=False)
class EpsilonField:
    """epsilon (n_inc, k) at points (k, 2) with areas `weights` (k,), mm^2.

    rim_distance, grip_distance (k,): to the nearest rim of a hole and the nearest clamped side, inf where there is
    none. time (n_inc,): load factor. cells (m, 9), nodes (n, 2): the plane mesh; cell i has the points 9 i to 9 i + 8.
    """

    points: Array
    weights: Array
    epsilon: Array
    rim_distance: Array
    grip_distance: Array
    time: Array
    cells: NDArray[np.int64]
    nodes: Array

    def save(self, path: str | Path) -> None:
        """Write a .npz with one array a field, atomically."""
        write_npz(path, **{name: getattr(self, name) for name in self.__dataclass_fields__})

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote."""
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as content:
            return cls(**{name: content[name] for name in cls.__dataclass_fields__})

    def near_holes(self, reach: float = NEAR_HOLE) -> NDArray[np.bool_]:
        """Which points (k,) are within `reach`, mm, of a rim."""
        return self.rim_distance <= reach

    def away_from_grips(self, zone: float) -> NDArray[np.bool_]:
        """Which points (k,) are further than `zone`, mm, from every clamped side."""
        return self.grip_distance > zone

    def statistics(self, where: NDArray[np.bool_] | None = None, increment: int = -1) -> Statistics:
        """Of an increment, over all points or those `where` true."""
        chosen = np.ones(len(self.weights), bool) if where is None else where
        return statistics(self.epsilon[increment][chosen], self.weights[chosen])


@dataclass(frozen=True)
class Statistics:
    """Area-weighted statistics of epsilon over an area, mm^2; NaN over no area."""

    maximum: float
    mean: float
    p95: float
    area: float

    def to_dict(self) -> dict[str, float]:
        """By name, for a file."""
        return asdict(self)


def epsilon_field(plane: SurfaceSolution, solid: Solid, specimen: Specimen = Cross()) -> EpsilonField:
    """epsilon of a 3D solution against the plane-stress one on the same plane mesh. Raises `SolutionError`."""
    points, weights, _ = plane.gauss()
    return EpsilonField(
        points,
        weights,
        epsilon(plane, solid),
        rim_distance(points, specimen),
        grip_distance(points, specimen),
        plane.time,
        plane.mesh.cells,
        plane.mesh.points,
    )


def epsilon(plane: SurfaceSolution, solid: Solid) -> Array:
    """epsilon (n_inc, k) at the Gauss points of the plane mesh, at equal load factors.

    Raises `SolutionError` where points or load factors differ.
    """
    points, _, F_plane = plane.gauss()
    solid_points, _, F_solid = solid.surface_gauss()
    if points.shape != solid_points.shape or not np.allclose(points, solid_points, atol=1e-9):
        raise SolutionError("the 3D solution stands on another plane mesh than the 2D one; solve both on the same")
    if plane.time.shape != solid.time.shape or not np.allclose(plane.time, solid.time, atol=1e-9):
        raise SolutionError(
            f"the 2D solution has {len(plane.time)} increments, the 3D one {len(solid.time)} or others; "
            "solve both with the same increments to the end"
        )
    return difference(F_plane, F_solid)


def difference(F_plane: Array, F_solid: Array) -> Array:
    """epsilon (...) of in-plane F (..., 2, 2) and 3D F (..., 3, 3), of which the first two columns count."""
    C_plane = np.einsum("...ia,...ib->...ab", F_plane, F_plane)
    in_plane = F_solid[..., :2]
    C_solid = np.einsum("...ia,...ib->...ab", in_plane, in_plane)
    return np.linalg.norm(C_plane - C_solid, axis=(-2, -1)) / np.linalg.norm(C_plane, axis=(-2, -1))


def statistics(values: Array, weights: Array) -> Statistics:
    """Maximum, weighted mean and weighted 95th percentile of values (k,)."""
    if not len(values):
        return Statistics(np.nan, np.nan, np.nan, 0.0)
    mean, p95 = float(np.average(values, weights=weights)), weighted_quantile(values, weights, 0.95)
    return Statistics(float(values.max()), mean, float(p95), float(weights.sum()))


def weighted_quantile(values: Array, weights: Array, share: float | Array) -> Any:
    """The smallest of values (k,) at or below which lies at least `share` of the weight (k,): float, or one a share."""
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    index = np.searchsorted(below, np.asarray(share) * below[-1] * (1 - 1e-12))
    found = values[order][np.minimum(index, len(order) - 1)]
    return float(found) if np.ndim(share) == 0 else found


def rim_distance(points: Array, specimen: Specimen = Cross()) -> Array:
    """Distance (k,) of points (k, 2) from the nearest rim of a hole of the specimen, mm; inf where it has none."""
    rims = [hole.rim(RIM_POINTS) for hole in specimen.holes()]
    return _distance(points, [(rim, np.roll(rim, -1, axis=0)) for rim in rims])


def grip_distance(points: Array, specimen: Specimen = Cross()) -> Array:
    """Distance (k,) of points (k, 2) from the nearest clamped side of the specimen, mm."""
    corners = np.array([(corner.x, corner.y) for corner in specimen.corners()])
    sides = []
    for name in specimen.loaded:
        axis, sign = SIDES[name]
        on_side = corners[np.isclose(sign * corners[:, axis], specimen.half_extent[axis])]
        sides.append((on_side.min(axis=0)[None], on_side.max(axis=0)[None]))
    return _distance(points, sides)


def _distance(points: Array, lines: list[tuple[Array, Array]]) -> Array:
    """Distance (k,) from the nearest straight piece; lines: starts and ends (s, 2) of the pieces of each."""
    nearest = np.full(len(points), np.inf)
    for starts, ends in lines:
        along = ends - starts
        offset = points[:, None] - starts
        share = np.clip((offset * along).sum(axis=-1) / (along**2).sum(axis=1), 0, 1)
        found = np.linalg.norm(offset - share[..., None] * along, axis=-1)
        nearest = np.minimum(nearest, found.min(axis=1))
    return nearest
