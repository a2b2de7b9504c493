"""Column-mapped import of full-field data from any DIC software that writes text tables.

In: a `ColumnMap` and the folder its paths are relative to. Out: a `Series`: frames matched point by point, pixels
to mm, y up, triangulated (Delaunay, holes left open), grips and free edges found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError, cKDTree

from calibrate import errors
from calibrate.data.triangulation import boundary_edges, boundary_nodes, signed_areas
from meshes.mesh import spacing_of
from meshes.shapes import Segment
from studies.importers.column_map import ColumnMap, read_map, tests_of
from studies.importers.frame_tables import Frames, read_frames
from studies.importers.load_cells import load_cells
from studies.importers.map_tables import EdgesTable
from studies.importers.masking.grip_points import along_grips
from studies.importers.masking.masks import SIDES, Masked, inwards, masked
from studies.importers.masking.single_readings import bridged
from studies.importers.recording.importer import Importer, Part, Processing, Recording, SheetOptions
from studies.importers.recording.missing_frames import with_missing_frames
from studies.importers.recording.notes import bridged_notes, edge_notes, mask_notes
from studies.importers.recording.series import Grip, Series
from studies.importers.recording.static_frames import noise_floor, static_count
from studies.importers.recording.synchronise import ForceRecord

Array = NDArray[np.float64]
ON_SIDE = 0.4  # of the distance of the points, within which a point is on a side
RUN = 2.5  # distances of points of a side, from which it has two parts
GAP = 1.6  # distances of points from a masked one, within which a node is on the rim of its gap
THIN_RIM = 0.1  # area over the square of an edge on the outline: a quarter in a square grid, 0.43 of equal sides
THIN = 0.02  # of the longest edge squared: such triangles are Delaunay's only along an outline of nearly straight rows
Index = NDArray[np.int64]


class ColumnMapped(Importer):
    """A column map (TOML), which states everything itself."""

    source: ClassVar[str] = "a column map .toml"
    looks_for: ClassVar[str] = "a name that ends with .toml"
    takes: ClassVar[tuple[Part, ...]] = ()
    instead: ClassVar[str] = "say it in the TOML file (docs/import.md)"

    def reads(self, source: str) -> bool:
        """A path that ends with .toml, or with .toml#NAME of a test in it."""
        return Path(source.partition("#")[0]).suffix == ".toml"

    def parts(self, source: str) -> tuple[str, ...]:
        """FILE#NAME of every [[test]]."""
        return () if "#" in source else tuple(f"{source}#{name}" for name in tests_of(source))

    def read(self, source: str, options: SheetOptions, name: str | None, record: Path | None) -> Recording:
        """Raises `ConfigError` for a map that cannot be, and the errors of its tables."""
        path = Path(source.partition("#")[0])
        columns = read_map(source)
        series = mapped_series(columns, path.parent)
        series.provenance.update(source=path.name, map=columns.model_dump(exclude_none=True))
        return Recording(series, (path,), Processing(columns.selection, columns.stated_noise, columns.noise.kind))


def mapped_series(m: ColumnMap, folder: str | Path) -> Series:
    """What `column_series` reads, with the frames that the camera left out."""
    series = column_series(m, folder)
    return series if m.frames.rate_hz is None else with_missing_frames(series)


def column_series(m: ColumnMap, folder: str | Path) -> Series:
    """Read the files of a column map; `folder` is where its relative paths start."""
    folder = Path(folder)
    frames = read_frames(m.points, folder, m.mask.column)
    whole = bridged(frames.points, _measured(frames), m.masks.outliers)
    mask, lone = _left_out(m, frames, whole.values[..., :2])
    mesh = _mesh(frames.points, ~mask.gone | lone, m.points.max_edge_mm)
    points = frames.points[mesh.kept]
    records, time = load_cells(m, folder, len(frames.displacements))
    cells: dict[str, ForceRecord] = {
        side: record for cell, record in zip(m.force, records, strict=True) for side in cell.sides if len(m.force) > 1
    }
    grips, free = _edges(m.edges, cells, points, mesh.triangles)
    free = _not_beside(free, points, frames.points[mask.gone & ~lone], m.edges)
    displacements = np.where(lone[:, None], np.nan, whole.values[..., :2])[:, mesh.kept]
    held = [(grip.nodes, 1 if grip.direction[0] else 0) for grip in grips]
    displacements, of_grips = along_grips(points, displacements, held)
    notes = bridged_notes(whole, of_grips) + mask_notes(frames.points, mask, frames.points[mesh.alone])
    notes += edge_notes(m.edges.loaded, m.edges.free, m.edges.rim)
    rate, clock = m.frames.rate_hz, any(not cell.per_frame for cell in m.force)
    return Series(
        name=m.name,
        points=points,
        triangles=mesh.triangles,
        displacements=displacements,
        time=time,
        record=records[0],
        grips=grips,
        free_nodes=free,
        thickness=m.thickness_mm,
        plane=m.plane,
        has_clock=rate is not None or m.frames.times_s is not None or all(cell.time for cell in m.force),
        # an offset that is stated is taken as known: an error of it moves all forces together, and is no noise of each
        synchronisation_std=1.0 / rate / np.sqrt(12.0) if clock and rate is not None and not m.frames.offset_s else 0.0,
        provenance={
            "reader": "column map",
            "points_without_triangle": len(mesh.alone),
            "bridged": {**whole.to_dict(), "on_grips": of_grips},
            "masked": mask.to_dict(frames.points),
            "rim": m.edges.rim,
            "notes": notes,
            "recording": m.recording.model_dump(exclude_none=True),
            **_static(m, points, mesh.triangles, displacements),
            **({} if frames.plane is None else {"specimen_plane": frames.plane.to_dict()}),
        },
        masked=frames.points[mask.gone],
        tested=True,
        lone=int(lone[mesh.kept].sum()),
        heights=None if frames.heights is None else whole.values[:, mesh.kept, 2],
        rims=(*m.edges.rims, *_lines(m.edges, points), *_true_sides(m.edges, points, mesh.triangles)),
        fits_holes="holes" in m.edges.free and m.edges.fit_holes,
    )


def _left_out(m: ColumnMap, frames: Frames, displacements: Array) -> tuple[Masked, NDArray[np.bool_]]:
    """Points that go, of displacements (n_frames, n, 2), mm; and those of them (n,) that go as failed ones do, as what is around them is triangulated."""
    seen = np.isfinite(frames.displacements).any(axis=(1, 2))  # frames that did not fail as a whole
    mask = masked(frames.points, displacements[seen], m.masks, frames.flagged)
    return mask, mask.lone(frames.points) & ~_at_sides(frames.points, m.edges.loaded, m.edges.tolerance_mm)


def _measured(frames: Frames) -> Array:
    """Displacements, and of stereo data the heights after them (n_frames, n, 2 or 3), mm."""
    heights = [] if frames.heights is None else [frames.heights[..., None]]
    return np.concatenate([frames.displacements, *heights], axis=2)


def _static(m: ColumnMap, points: Array, triangles: Index, displacements: Array) -> dict[str, Any]:
    """Noise floor of the frames before the loading, as many as stated or as show no strain."""
    count = m.recording.static_frames or static_count(points, displacements)
    floor = noise_floor(points, triangles, displacements[1 : count + 1])
    return {} if floor is None else {"static": floor.to_dict()}


@dataclass(frozen=True, eq=False)
class Mesh:
    """kept (k,): points with a triangle; alone: those without; triangles (m, 3) in numbers of kept."""

    kept: Index
    alone: Index
    triangles: Index


def _mesh(points: Array, staying: NDArray[np.bool_], max_edge: float | None) -> Mesh:
    """Triangles of the points that stay."""
    inside = np.flatnonzero(staying)
    triangles = inside[_triangles(points[inside], max_edge)]
    kept = np.unique(triangles)
    return Mesh(kept, np.setdiff1d(inside, kept), np.searchsorted(kept, triangles))


def _not_beside(free: Index, points: Array, gone: Array, edges: EdgesTable) -> Index:
    """Free nodes that are no rim of a gap which masked points left: nothing is known of the traction there."""
    if not len(gone) or not free.size or "holes" not in edges.free:
        return free
    pitch = spacing_of(points)
    outer = _at_sides(points, edges.free, edges.tolerance_mm)
    near = cKDTree(gone).query(points[free])[0] < GAP * pitch
    return free[~near | outer[free]]


def _at_sides(points: Array, sides: Sequence[str], tolerance: float | None = None) -> NDArray[np.bool_]:
    """Points (n,) that are as far out as the outermost one on any of these sides, within a tolerance, mm."""
    within = tolerance or ON_SIDE * spacing_of(points)
    found = [inwards(points, side) <= within for side in sides if side in SIDES]
    return np.any(found, axis=0) if found else np.zeros(len(points), bool)


def _triangles(points: Array, max_edge: float | None) -> Index:
    """Delaunay triangles whose edges are no longer than `max_edge` mm (default 2.2 times the spacing)."""
    try:
        triangles = Delaunay(points).simplices.astype(np.int64)
    except QhullError:
        raise errors.DegenerateMeshError(
            f"the {len(points)} points that are left span no area, as points on a line; see points.x and points.y, and [mask]"
        ) from None
    area = signed_areas(points, triangles)
    triangles[area < 0] = triangles[area < 0][:, ::-1]
    corners = points[triangles]
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    limit = max_edge or 2.2 * spacing_of(points)
    keep = (edge <= limit) & (np.abs(area) > THIN * edge**2)
    if not keep.any():
        raise errors.ConfigError(f"no triangle has edges below points.max_edge_mm = {limit:g} mm")
    return _without_thin_rim(points, triangles[keep])


def _without_thin_rim(points: Array, triangles: Index) -> Index:
    """Triangles (m, 3) without flat ones whose longest edge is on the outline: rows that noise has bent."""
    while True:
        edges, owners = boundary_edges(triangles)
        length = np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)
        flat = signed_areas(points, triangles)[owners] < THIN_RIM * length**2
        if not flat.any() or flat.all():
            return triangles
        triangles = np.delete(triangles, owners[flat], axis=0)


def _edges(
    table: EdgesTable, cells: dict[str, ForceRecord], points: Array, triangles: Index
) -> tuple[tuple[Grip, ...], Index]:
    """Loaded sides and free nodes. cells: record of the load cell of every side, empty where there is only one."""
    nodes, loaded = _sides(table, points, triangles), table.loaded
    taken = np.concatenate([nodes[side] for side in loaded])
    if len(np.unique(taken)) < len(taken):
        raise errors.ConfigError(
            f"edges.loaded: sides {', '.join(loaded)} share corner nodes; only sides that do not meet can be loaded"
        )
    grips = []
    for side in loaded:
        axis, sign = SIDES[side]
        direction = (float(sign), 0.0) if axis == 0 else (0.0, float(sign))
        grips.append(Grip(side, nodes[side], direction, cells.get(side)))
    rim = boundary_nodes(triangles)
    free = [nodes[side] for side in table.free if side in SIDES]
    if "holes" in table.free:
        free.append(np.setdiff1d(rim, np.concatenate(list(nodes.values()))))
    return tuple(grips), np.setdiff1d(np.unique(np.concatenate([*free, []])), taken).astype(np.int64)


def _lines(table: EdgesTable, points: Array) -> list[Segment]:
    """Straight edges with the nearest points on their left."""
    found = []
    for line in table.lines:
        segment = Segment(line.start, line.end)
        nearest = cKDTree(points).query(segment.rim())[1]
        beside = segment.cuts(points[nearest])
        found.append(Segment(line.end, line.start) if beside.mean() > 0.5 else segment)
    return found


def _true_sides(table: EdgesTable, points: Array, triangles: Index) -> list[Segment]:
    """The edge beyond each side that has one: from end to end of every run of its points."""
    nodes, pitch, found = _sides(table, points, triangles), spacing_of(points), []
    for side, distance in table.beyond_mm.items():
        axis, sign = SIDES[side]
        places = points[nodes[side]]
        along = np.sort(places[:, 1 - axis])
        at = sign * ((sign * places[:, axis]).max() + distance)
        for run in np.split(along, np.flatnonzero(np.diff(along) > RUN * pitch) + 1):
            ends = [(at, float(end)) if axis == 0 else (float(end), at) for end in (run[0], run[-1])]
            forward = sign > 0 if axis == 0 else sign < 0  # the specimen is on the left
            found.append(Segment(*(ends if forward else ends[::-1])))
    return found


def _sides(table: EdgesTable, points: Array, triangles: Index) -> dict[str, Index]:
    """Nodes of every side of the outline."""
    rim = boundary_nodes(triangles)
    return {side: rim[_at_sides(points, (side,), table.tolerance_mm)[rim]] for side in SIDES}
