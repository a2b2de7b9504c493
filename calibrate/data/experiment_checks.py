"""Checks of a measured surface test: every violation is a named error that says where and what to do.

In: the arrays of an Experiment. Out: nothing, or the error of the first check that fails.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate import errors
from calibrate.data.load_record import LoadRecord
from calibrate.data.measurement import LoadedBoundary
from calibrate.data.triangulation import boundary_nodes, signed_areas

PLANES = ("stress", "strain")
Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Record(Protocol):
    """The arrays of an Experiment, see there."""

    @property
    def points(self) -> Array: ...
    @property
    def triangles(self) -> Indices: ...
    @property
    def displacements(self) -> Array: ...
    @property
    def loaded(self) -> tuple[LoadedBoundary, ...]: ...
    @property
    def free_nodes(self) -> Indices: ...
    @property
    def thickness(self) -> float | None: ...
    @property
    def time(self) -> Array | None: ...
    @property
    def plane(self) -> str: ...
    @property
    def heights(self) -> Array | None: ...
    @property
    def record(self) -> LoadRecord | None: ...
    @property
    def continued(self) -> sp.csr_array | None: ...


def check(record: Record) -> None:
    """Run every check; raises the named error of the first that fails."""
    _check_shapes(record)
    _check_nodes(record)
    _check_times(record)
    _check_mesh(record)
    _check_loads(record)
    if record.record is not None:
        record.record.check(record.time, len(record.loaded))
    _check_units(record)
    _check_deformation(record)


def _place(point: Array) -> str:
    """'(1.2, 3.4) mm' of a point (2,)."""
    return f"({point[0]:.4g}, {point[1]:.4g}) mm"


def _count(mask: NDArray[np.bool_], places: Array) -> str:
    """'3, the first at (1.2, 3.4) mm' for the true entries of `mask` (k,), which lie at places (k, 2)."""
    return f"{int(mask.sum())}, the first at {_place(places[mask][0])}"


def _check_shapes(e: Record) -> None:
    if e.plane not in PLANES:
        raise errors.ConfigError(f"plane '{e.plane}' unknown; choose one of {', '.join(PLANES)}")
    n = e.points.shape[0]
    if e.points.ndim != 2 or e.points.shape[1] != 2 or e.triangles.ndim != 2 or e.triangles.shape[1] != 3:
        raise errors.MeshMismatchError(
            f"points must be (n, 2) and triangles (m, 3), not {e.points.shape} and {e.triangles.shape}"
        )
    if e.displacements.ndim != 3 or e.displacements.shape[1:] != (n, 2):
        raise errors.MeshMismatchError(
            f"displacements {e.displacements.shape} do not match {n} nodes; expected (n_increments, {n}, 2): "
            "were mesh and displacements exported from the same analysis?"
        )
    if e.heights is not None and e.heights.shape != (len(e.displacements) + 1, n):
        raise errors.MeshMismatchError(
            f"heights {e.heights.shape} do not match; expected ({len(e.displacements) + 1}, {n}): the reference and every increment"
        )
    if e.continued is not None and (sum(e.continued.shape) != n or not np.isfinite(e.continued.data).all()):
        raise errors.MeshMismatchError(
            f"continued {e.continued.shape} does not match {n} nodes; expected (k, {n} - k), finite: import the test again"
        )
    if len(e.displacements) == 0 or len(e.triangles) == 0:
        raise errors.MeshMismatchError("an Experiment needs at least one increment and one triangle")


def _check_nodes(e: Record) -> None:
    n = len(e.points)
    nodes = [("triangles", e.triangles), ("free_nodes", e.free_nodes)]
    nodes += [(f"nodes of '{b.name}'", b.nodes) for b in e.loaded]
    for what, index in nodes:
        if index.size and (index.min() < 0 or index.max() >= n):
            raise errors.MeshMismatchError(
                f"{what}: node numbers run from {index.min()} to {index.max()}, but there are {n} nodes (count from 0)"
            )
    for b in e.loaded:
        if b.force.shape != (len(e.displacements), 2):
            raise errors.MeshMismatchError(
                f"force of '{b.name}' has shape {b.force.shape}, expected ({len(e.displacements)}, 2): one row an increment"
            )


def _check_times(e: Record) -> None:
    if e.time is None:
        return
    if e.time.shape != (len(e.displacements),):
        raise errors.MeshMismatchError(f"time has shape {e.time.shape}, expected ({len(e.displacements)},)")
    backwards = ~(np.diff(e.time) > 0)
    if backwards.any() or not np.isfinite(e.time).all():
        where = int(np.flatnonzero(backwards)[0]) + 1 if backwards.any() else -1
        raise errors.TimeError(f"time does not increase at increment {where}; sort or drop repeated frames")
    if e.time[0] < 0:
        raise errors.TimeError(f"time begins at {e.time[0]:g} s; count it from the start of loading")


def _check_mesh(e: Record) -> None:
    if not np.isfinite(e.points).all():
        raise errors.DegenerateMeshError("reference points are not finite; drop those points and re-triangulate")
    area = signed_areas(e.points, e.triangles)
    centroids = e.points[e.triangles].mean(axis=1)
    if (area < 0).any():
        raise errors.DegenerateMeshError(
            f"inverted triangles: {_count(area < 0, centroids)}; order nodes counter-clockwise (image y-axes point down: flip y)"
        )
    size = np.sqrt(np.median(np.abs(area)))
    flat = area <= 1e-8 * size**2
    if flat.any():
        raise errors.DegenerateMeshError(f"triangles without area: {_count(flat, centroids)}; re-triangulate")
    rounded = np.round(e.points / (1e-7 * max(size, 1e-300))).astype(np.int64)
    _, first, count = np.unique(rounded, axis=0, return_index=True, return_counts=True)
    if (count > 1).any():
        raise errors.DegenerateMeshError(
            f"duplicate nodes: {_count(count > 1, e.points[first])}; merge nodes at the same place"
        )
    unused = np.setdiff1d(np.arange(len(e.points)), e.triangles)
    if unused.size:
        raise errors.DegenerateMeshError(
            f"{unused.size} nodes belong to no triangle, the first at {_place(e.points[unused[0]])}; drop them"
        )


def _check_loads(e: Record) -> None:
    if not any(np.isfinite(b.force).any() for b in e.loaded):
        raise errors.MissingForceError(
            "no force was measured on any loaded boundary: without one only ratios of stiffness can be found; "
            "give the load-cell record"
        )
    rim = boundary_nodes(e.triangles)
    taken: dict[int, set[int]] = {0: set(), 1: set()}
    for b in e.loaded:
        if b.nodes.size < 2:
            raise errors.ExperimentError(f"loaded boundary '{b.name}' has {b.nodes.size} nodes; it needs at least 2")
        if not np.isin(b.nodes, rim).all():
            raise errors.MeshMismatchError(
                f"loaded boundary '{b.name}' contains nodes inside the specimen; list its edge nodes only"
            )
        _check_held(b)
        for component in np.flatnonzero(b.held).tolist():
            if taken[component].intersection(b.nodes.tolist()):
                raise errors.ExperimentError(f"loaded boundary '{b.name}' shares nodes with another; separate them")
            taken[component].update(b.nodes.tolist())
        if np.isinf(b.force).any():
            raise errors.MissingForceError(f"force of '{b.name}' is infinite; use NaN for what was not measured")
    if not np.isin(e.free_nodes, rim).all():
        raise errors.MeshMismatchError("free_nodes contains nodes inside the specimen; list edge nodes only")
    if (taken[0] | taken[1]).intersection(e.free_nodes.tolist()):
        raise errors.ExperimentError("a node is both loaded and free; a gripped node is not free")


def _check_held(boundary: LoadedBoundary) -> None:
    if not any(boundary.held):
        raise errors.ExperimentError(f"loaded boundary '{boundary.name}' holds nothing; list its nodes as free")
    sliding = ~np.array(boundary.held)
    if np.any(boundary.force[:, sliding] != 0):
        raise errors.ExperimentError(
            f"loaded boundary '{boundary.name}' slides along {'xy'[int(np.flatnonzero(sliding)[0])]} and has a force that way; "
            "give 0, or hold it"
        )


def _check_units(e: Record) -> None:
    extent = float(np.ptp(e.points, axis=0).max())
    if not 0.5 <= extent <= 5000:
        raise errors.UnitsError(f"the specimen is {extent:.3g} mm long; points must be in mm (0.5 to 5000)")
    moved = float(np.nanmax(np.abs(e.displacements))) if np.isfinite(e.displacements).any() else 0.0
    if moved > 20 * extent:
        raise errors.UnitsError(
            f"displacements reach {moved:.3g} mm on a {extent:.3g} mm specimen; give mm, not pixels"
        )
    if 0 < moved < 1e-6 * extent:
        raise errors.UnitsError(
            f"displacements stay below {moved:.3g} mm on a {extent:.3g} mm specimen; give mm, not m"
        )
    if e.thickness is not None and not 1e-3 <= e.thickness <= extent:
        raise errors.UnitsError(f"thickness {e.thickness:.3g} mm on a {extent:.3g} mm specimen is implausible; give mm")
    force = max(float(np.nanmax(np.abs(b.force), initial=0.0)) for b in e.loaded)
    stress = force / (extent * (e.thickness or 1.0))
    if stress > 1e3 or 0 < stress < 1e-9:
        raise errors.UnitsError(
            f"a force of {force:.3g} N means a nominal stress of about {stress:.2g} MPa; give N (not kN or mN)"
        )


def _check_deformation(e: Record) -> None:
    bad = ~np.isfinite(e.displacements).all(axis=(0, 2))
    if bad.any():
        raise errors.InvalidDeformationError(
            f"displacements of {int(bad.sum())} nodes are not finite, the first at {_place(e.points[bad][0])}; leave them out: "
            "`calibrate.data.points.drop_points`, or [mask] points of a column map"
        )
    area = signed_areas(e.points, e.triangles)
    for i, u in enumerate(e.displacements):
        jacobian = signed_areas(e.points + u, e.triangles) / area
        if (jacobian <= 0).any():
            raise errors.InvalidDeformationError(
                f"increment {i}: det F <= 0 in {int((jacobian <= 0).sum())} triangles, the first at "
                f"{_place(e.points[e.triangles[jacobian <= 0][0]].mean(axis=0))}; points there are wrong: leave them out ([mask] points or boxes "
                "of a column map, `calibrate.data.points.drop_points`), or the frame (frames.list, --frames); many at once: the sign of a displacement or the direction "
                "of an axis is wrong (points.y_axis)"
            )
