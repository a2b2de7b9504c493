"""Column-mapped import of full-field data from any DIC software that writes text tables.

In: a `ColumnMap` and the folder its paths are relative to. Out: a `Series`: frames matched point by point, pixels
to mm, y up, triangulated (Delaunay, holes left open), grips and free edges found.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, cKDTree

from calibrate import errors
from calibrate.data.triangulation import boundary_nodes, signed_areas
from studies.importers.column_frames import frame_paths, read_frames
from studies.importers.column_map import (
    FORCE_UNITS,
    TIME_UNITS,
    ColumnMap,
    EdgesTable,
    read_map,
)
from studies.importers.recording.importer import Importer, Part, Processing, Recording, SheetOptions
from studies.importers.recording.masks import SIDES, masked
from studies.importers.recording.missing_frames import with_missing_frames
from studies.importers.recording.notes import edge_notes, mask_notes
from studies.importers.recording.series import Grip, Series
from studies.importers.recording.synchronise import ForceRecord
from studies.importers.text_tables import Layout, read_table

Array = NDArray[np.float64]
GAP = 1.6  # distances of points from a masked one, within which a node is on the rim of its gap
Index = NDArray[np.int64]


class ColumnMapped(Importer):
    """A column map (TOML), which states everything itself."""

    source: ClassVar[str] = "a column map .toml"
    looks_for: ClassVar[str] = "a name that ends with .toml"
    takes: ClassVar[tuple[Part, ...]] = ()
    instead: ClassVar[str] = "say it in the TOML file (docs/import.md)"

    def reads(self, source: str) -> bool:
        """A path that ends with .toml."""
        return Path(source).suffix == ".toml"

    def read(self, source: str, options: SheetOptions, name: str | None, record: Path | None) -> Recording:
        """Raises `ConfigError` for a map that cannot be, and the errors of its tables."""
        path = Path(source)
        columns = read_map(path)
        series = column_series(columns, path.parent)
        series.provenance.update(source=path.name, map=columns.model_dump(exclude_none=True))
        if columns.frames.rate_hz is not None:
            series = with_missing_frames(series)
        return Recording(series, (path,), Processing(columns.selection, columns.stated_noise, columns.noise.kind))


def column_series(m: ColumnMap, folder: str | Path) -> Series:
    """Read the files of a column map; `folder` is where its relative paths start."""
    folder = Path(folder)
    paths = frame_paths(folder, m.points.files)
    everything, displacements, flagged = read_frames(m.points, paths, m.mask.column)
    seen = np.isfinite(displacements).any(axis=(1, 2))  # frames that did not fail as a whole
    mask = masked(everything, displacements[seen], m.masks, flagged)
    points, displacements = everything[~mask.gone], displacements[:, ~mask.gone]
    triangles = _triangles(points, m.points.max_edge_mm)
    used = np.unique(triangles)
    alone = points[np.setdiff1d(np.arange(len(points)), used)]
    points, displacements = points[used], displacements[:, used]
    triangles = np.searchsorted(used, triangles)
    grips, free = _edges(m.edges, points, triangles)
    free = _not_beside(free, points, everything[mask.gone], m.edges)
    record, time = _force(m, folder, len(paths))
    notes = mask_notes(everything, mask, alone) + edge_notes(m.edges.loaded, m.edges.free, m.edges.rim)
    rate = m.frames.rate_hz
    return Series(
        name=m.name,
        points=points,
        triangles=triangles,
        displacements=displacements,
        time=time,
        record=record,
        grips=grips,
        free_nodes=free,
        thickness=m.thickness_mm,
        plane=m.plane,
        synchronisation_std=0.0 if m.force.per_frame or rate is None else 1.0 / rate / np.sqrt(12.0),
        provenance={
            "reader": "column map",
            "points_without_triangle": len(alone),
            "masked": mask.to_dict(everything),
            "rim": m.edges.rim,
            "notes": notes,
        },
        masked=everything[mask.gone],
        tested=True,
    )


def _not_beside(free: Index, points: Array, gone: Array, edges: EdgesTable) -> Index:
    """Free nodes that are no rim of a gap which masked points left: nothing is known of the traction there."""
    if not len(gone) or not free.size or "holes" not in edges.free:
        return free
    pitch = float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))
    sides = [sign * points[:, axis] for axis, sign in (SIDES[s] for s in edges.free if s in SIDES)]
    outer = (
        np.any([value >= value.max() - 0.4 * pitch for value in sides], axis=0)
        if sides
        else np.zeros(len(points), bool)
    )
    near = cKDTree(gone).query(points[free])[0] < GAP * pitch
    return free[~near | outer[free]]


def _triangles(points: Array, max_edge: float | None) -> Index:
    """Delaunay triangles whose edges are no longer than `max_edge` mm (default 2.2 times the spacing)."""
    triangles = Delaunay(points).simplices.astype(np.int64)
    area = signed_areas(points, triangles)
    triangles[area < 0] = triangles[area < 0][:, ::-1]
    corners = points[triangles]
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    limit = max_edge or 2.2 * float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))
    keep = (edge <= limit) & (np.abs(area) > 1e-4 * edge**2)
    if not keep.any():
        raise errors.ConfigError(f"no triangle has edges below points.max_edge_mm = {limit:g} mm")
    return triangles[keep]


def _edges(table: EdgesTable, points: Array, triangles: Index) -> tuple[tuple[Grip, ...], Index]:
    rim = boundary_nodes(triangles)
    pitch = float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))
    tolerance = table.tolerance_mm or 0.4 * pitch
    nodes = {}
    for side, (axis, sign) in SIDES.items():
        value = sign * points[:, axis]
        nodes[side] = rim[value[rim] >= value.max() - tolerance]
    taken = np.concatenate([nodes[side] for side in table.loaded])
    if len(np.unique(taken)) < len(taken):
        corners = f"{', '.join(table.loaded)}"
        raise errors.ConfigError(f"edges.loaded: sides {corners} share corner nodes; only opposite sides can be loaded")
    grips = []
    for side in table.loaded:
        axis, sign = SIDES[side]
        grips.append(Grip(side, nodes[side], (float(sign), 0.0) if axis == 0 else (0.0, float(sign))))
    free = [nodes[side] for side in table.free if side in SIDES]
    if "holes" in table.free:
        free.append(np.setdiff1d(rim, np.concatenate(list(nodes.values()))))
    return tuple(grips), np.setdiff1d(np.unique(np.concatenate([*free, []])), taken).astype(np.int64)


def _force(m: ColumnMap, folder: Path, n_frames: int) -> tuple[ForceRecord, Array]:
    """The machine record and the time of every frame on its clock, s."""
    f = m.force
    layout = Layout(f.delimiter, f.header_line, f.units_row, f.comment, missing_allowed=True)
    columns = [f.force] + ([f.time] if f.time else [])
    table = read_table(folder / f.file, columns, layout)
    force = f.sign * FORCE_UNITS[f.unit] * table[f.force]
    source = str(folder / f.file)
    if not f.per_frame:
        assert f.time is not None
        assert m.frames.rate_hz is not None
        record = ForceRecord(TIME_UNITS[f.time_unit] * table[f.time], force, source)
        return record, np.arange(n_frames) / m.frames.rate_hz + m.frames.offset_s
    if len(force) != n_frames:
        raise errors.MeshMismatchError(
            f"{source}: {len(force)} forces for {n_frames} frames; one row a frame is needed"
        )
    if f.time:
        time = TIME_UNITS[f.time_unit] * table[f.time]
    else:
        time = np.arange(n_frames) / (m.frames.rate_hz or 1.0) + m.frames.offset_s
    return ForceRecord(time, force, source), time
