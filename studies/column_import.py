"""Column-mapped import of full-field data from any DIC software that writes text tables.

In: one TOML file that names files, columns, units and separators (docs/import.md; examples in docs/import/).
Out: a `Series`. Unknown keys are refused with the nearest known one. Paths are relative to the TOML file.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypeVar, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, cKDTree

from calibrate import errors
from calibrate.experiment import Noise, boundary_nodes, signed_areas
from studies.series import ForceRecord, Grip, Selection, Series
from studies.tables import Layout, read_table

Array = NDArray[np.float64]
Index = NDArray[np.int64]
LENGTH_UNITS = {"mm": 1.0, "cm": 10.0, "m": 1e3, "um": 1e-3}
FORCE_UNITS = {"N": 1.0, "kN": 1e3, "mN": 1e-3}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "min": 60.0}
SIDES = {"left": (0, -1), "right": (0, 1), "bottom": (1, -1), "top": (1, 1)}


@dataclass(frozen=True)
class PointsTable:
    """[points]: one table a frame. files: glob; the frames are sorted by the last number in their names and the
    first is the reference. x, y, u, v: columns of position and displacement. unit: 'px' with scale_mm_per_px, or
    a length. y_axis: 'up' or 'down' (image coordinates). coordinates: 'reference' or 'current' (position after
    displacement). valid_column with valid_minimum and/or valid_maximum: other points have failed."""

    files: str
    x: str
    y: str
    u: str
    v: str
    unit: str = "mm"
    scale_mm_per_px: float | None = None
    y_axis: str = "up"
    coordinates: str = "reference"
    delimiter: str = ","
    header_line: int = 1
    units_row: bool = False
    comment: str = ""
    valid_column: str | None = None
    valid_minimum: float | None = None
    valid_maximum: float | None = None
    max_edge_mm: float | None = None


@dataclass(frozen=True)
class FramesTable:
    """[frames]: rate_hz and offset_s (time of the reference frame on the clock of the machine), or one force a
    frame ([force] per_frame). count, list, until_s, onset, tare_N: which frames are kept (see `Selection`)."""

    rate_hz: float | None = None
    offset_s: float = 0.0
    count: int = 12
    list: tuple[int, ...] | None = None
    until_s: float | None = None
    onset: float = 0.01
    tare_N: float | None = None


@dataclass(frozen=True)
class ForceTable:
    """[force]: file and columns of the machine record; sign = -1 where tension is recorded as negative.
    per_frame: one row a frame, in their order; then no time is needed."""

    file: str
    force: str
    time: str | None = None
    unit: str = "N"
    time_unit: str = "s"
    sign: float = 1.0
    per_frame: bool = False
    delimiter: str = ","
    header_line: int = 1
    units_row: bool = False
    comment: str = ""


@dataclass(frozen=True)
class EdgesTable:
    """[edges]: loaded: sides ('left', 'right', 'bottom', 'top') that are gripped, each with the force of the record
    pulling outwards; free: sides and 'holes' that are truly traction-free. tolerance_mm: nodes this close to the
    extreme coordinate belong to the side (default: 0.4 of the spacing of the points)."""

    loaded: tuple[str, ...]
    free: tuple[str, ...] = ()
    tolerance_mm: float | None = None


@dataclass(frozen=True)
class NoiseTable:
    """[noise]: stated noise; without this table it is estimated. kind: 'total' or 'temporal' of the estimate."""

    displacement_std_mm: float | None = None
    correlation_length_mm: float = 0.0
    force_std_relative: float = 0.0
    force_std_N: float = 0.0
    kind: str = "total"


@dataclass(frozen=True)
class ColumnMap:
    """The whole TOML file."""

    name: str
    points: PointsTable
    force: ForceTable
    edges: EdgesTable
    frames: FramesTable = field(default_factory=FramesTable)
    noise: NoiseTable = field(default_factory=NoiseTable)
    thickness_mm: float | None = None

    @property
    def selection(self) -> Selection:
        f = self.frames
        return Selection(f.count, f.list, f.until_s, f.onset, f.tare_N)

    @property
    def stated_noise(self) -> Noise | None:
        n = self.noise
        if n.displacement_std_mm is None:
            return None
        return Noise(n.displacement_std_mm, n.correlation_length_mm, n.force_std_relative, n.force_std_N)


Table = TypeVar("Table")


def read_map(path: str | Path) -> ColumnMap:
    """Read a TOML column map. Raises `ConfigError` that names the key, `DataNotFoundError`."""
    path = Path(path)
    if not path.is_file():
        raise errors.DataNotFoundError(f"{path}: no such file; see docs/import.md for column maps")
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise errors.ConfigError(f"{path}: not valid TOML ({error})") from error
    found = parse_table(ColumnMap, content, str(path))
    _check_map(found, str(path))
    return found


def parse_table(kind: type[Table], content: dict[str, Any], where: str) -> Table:
    """A dataclass from a TOML table: unknown, missing and wrongly typed keys raise `ConfigError`."""
    hints = get_type_hints(kind)
    for key in content:
        if key not in hints:
            close = difflib.get_close_matches(key, hints, 1)
            hint = f"did you mean '{close[0]}'?" if close else f"known: {', '.join(hints)}"
            raise errors.ConfigError(f"{where}: unknown key '{key}'; {hint}")
    required = [f.name for f in fields(kind) if _required(f) and f.name not in content]  # type: ignore[arg-type]
    if required:
        raise errors.ConfigError(f"{where}: key '{required[0]}' is missing")
    return kind(**{key: _value(hints[key], value, f"{where}: {key}") for key, value in content.items()})


def _required(f: Any) -> bool:
    return f.default is MISSING and f.default_factory is MISSING


def _value(hint: Any, value: Any, where: str) -> Any:
    options = get_args(hint) if isinstance(hint, UnionType) else (hint,)
    option = next(o for o in options if o is not NoneType)
    if hasattr(option, "__dataclass_fields__"):
        if not isinstance(value, dict):
            raise errors.ConfigError(f"{where} must be a table")
        return parse_table(option, value, where)
    if get_args(option):  # tuple[x, ...]
        if not isinstance(value, list):
            raise errors.ConfigError(f"{where} must be a list, not {value!r}")
        return tuple(_value(get_args(option)[0], v, where) for v in value)
    if option is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not option:
        raise errors.ConfigError(f"{where} must be of type {option.__name__}, not {value!r}")
    return value


def _check_map(m: ColumnMap, where: str) -> None:
    p = m.points
    choices = [
        ("points.unit", p.unit, ["px", *LENGTH_UNITS]),
        ("points.y_axis", p.y_axis, ["up", "down"]),
        ("points.coordinates", p.coordinates, ["reference", "current"]),
        ("force.unit", m.force.unit, list(FORCE_UNITS)),
        ("force.time_unit", m.force.time_unit, list(TIME_UNITS)),
        *(("edges.loaded", side, list(SIDES)) for side in m.edges.loaded),
        *(("edges.free", side, [*SIDES, "holes"]) for side in m.edges.free),
    ]
    for key, value, known in choices:
        if value not in known:
            raise errors.ConfigError(f"{where}: {key} = '{value}' unknown; choose one of {', '.join(known)}")
    if (p.unit == "px") != (p.scale_mm_per_px is not None):
        raise errors.ConfigError(f"{where}: points.scale_mm_per_px belongs to unit 'px', and only to it")
    if not m.edges.loaded or set(m.edges.loaded) & set(m.edges.free):
        raise errors.ConfigError(f"{where}: edges.loaded must name a side, and a loaded side is not free")
    if not m.force.per_frame and (m.frames.rate_hz is None or m.force.time is None):
        raise errors.ConfigError(f"{where}: give frames.rate_hz and force.time, or force.per_frame = true")


def column_series(m: ColumnMap, folder: str | Path) -> Series:
    """Read the files of a column map; `folder` is where its relative paths start."""
    folder = Path(folder)
    paths = _frame_paths(folder, m.points.files)
    points, displacements, first = _read_frames(m.points, paths)
    triangles = _triangles(points, m.points.max_edge_mm)
    used = np.unique(triangles)
    points, displacements = points[used], displacements[:, used]
    triangles = np.searchsorted(used, triangles)
    grips, free = _edges(m.edges, points, triangles)
    record, time = _force(m, folder, len(paths))
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
        synchronisation_std=0.0 if m.force.per_frame or rate is None else 1.0 / rate / np.sqrt(12.0),
        provenance={"reader": "column map", "points_without_triangle": int(first - used.size)},
    )


def _frame_paths(folder: Path, pattern: str) -> list[Path]:
    found = [p for p in folder.glob(pattern) if p.is_file()]
    numbered = [([int(n) for n in re.findall(r"\d+", p.stem)][-1:] or [-1], str(p), p) for p in found]
    paths = [p for _, _, p in sorted(numbered)]
    if len(paths) < 2:
        raise errors.DataNotFoundError(
            f"{folder / pattern}: {len(paths)} files; points.files must match the reference and at least one frame"
        )
    return paths


def _read_frames(p: PointsTable, paths: list[Path]) -> tuple[Array, Array, int]:
    """Reference points (n, 2) mm, displacements (n_frames, n, 2) mm (NaN = failed), and n."""
    columns = [p.x, p.y, p.u, p.v] + ([p.valid_column] if p.valid_column else [])
    layout = Layout(p.delimiter, p.header_line, p.units_row, p.comment, missing_allowed=True)
    scale = p.scale_mm_per_px if p.scale_mm_per_px is not None else LENGTH_UNITS[p.unit]
    axes = scale * np.array([1.0, -1.0 if p.y_axis == "down" else 1.0])
    frames = []
    for path in paths:
        table = read_table(path, columns, layout)
        position = np.stack([table[p.x], table[p.y]], axis=1) * axes
        moved = np.stack([table[p.u], table[p.v]], axis=1) * axes
        if p.valid_column:
            quality = table[p.valid_column]
            good = np.isfinite(quality)
            good &= quality >= p.valid_minimum if p.valid_minimum is not None else True
            good &= quality <= p.valid_maximum if p.valid_maximum is not None else True
            moved[~good] = np.nan
        frames.append((position - moved if p.coordinates == "current" else position, moved))
    points = frames[0][0]
    known = np.isfinite(points).all(axis=1)
    points = points[known]
    if len(points) < 4:
        raise errors.LostPointsError(f"{paths[0]}: {len(points)} valid points in the reference frame")
    distance = cKDTree(points).query(points, k=2)[0][:, 1]
    if distance.min() < 1e-6 * np.median(distance) or not np.median(distance) > 0:
        raise errors.DegenerateMeshError(f"{paths[0]}: points are listed twice; export each point once")
    displacements = np.stack(
        [_matched(points, *frame, path) for frame, path in zip(frames, paths, strict=True)]
    )
    return points, displacements, len(points)


def _matched(points: Array, position: Array, moved: Array, path: Path) -> Array:
    """Displacements (n, 2) at `points` of a frame listed in any order; NaN where it has no such point."""
    pitch = float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))
    known = np.isfinite(position).all(axis=1) & np.isfinite(moved).all(axis=1)
    result = np.full((len(points), 2), np.nan)
    if not known.any():
        return result
    distance, index = cKDTree(points).query(position[known])
    near = distance < 0.3 * pitch
    if near.mean() < 0.5:
        raise errors.MeshMismatchError(
            f"{path}: {int((~near).sum())} of {near.size} points are not in the reference frame; if positions move "
            "with the specimen, set points.coordinates = 'current'"
        )
    result[index[near]] = moved[known][near]
    return result


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
        raise errors.ConfigError(
            f"edges.loaded: sides {corners} share corner nodes; only opposite sides can be loaded"
        )
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
        assert f.time is not None and m.frames.rate_hz is not None
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
