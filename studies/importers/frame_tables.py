"""Frames of a column map: tables, matrices or a ncorr file in, displacements at the points of the reference out.

In: a `PointsTable` and the folder that its paths are relative to. Out: `Frames`, mm, y up, in the plane of the specimen.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibrate import errors
from meshes.mesh import spacing_of
from studies.importers.exports.frame_order import Order, frame_order
from studies.importers.exports.hdf5_file import read_columns
from studies.importers.exports.ncorr_file import read_ncorr
from studies.importers.exports.specimen_plane import Plane, fitted_plane
from studies.importers.map_tables import PointsTable
from studies.importers.text_tables import read_table

Array = NDArray[np.float64]
MOVED = 0.02  # of the displacements of the last frame: more than noise
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Frames:
    """points (n, 2); displacements (n_frames, n, 2), NaN = failed; both mm. flagged (n,): where the masking column is not 0.

    heights (n_frames, n) mm above the plane fitted to the reference, and plane: of stereo data. paths: files; order: how they were sorted, None: as listed.
    """

    points: Array
    displacements: Array
    flagged: Flags | None
    paths: list[Path]
    order: Order | None = None
    heights: Array | None = None
    plane: Plane | None = None


@dataclass(frozen=True, eq=False)
class Frame:
    """position, moved (k, 2 or 3), mm, y up. source: for messages."""

    position: Array
    moved: Array
    source: str


def frame_files(p: PointsTable, folder: Path) -> tuple[list[Path], Order | None]:
    """Files of the frames in their order. Raises `DataNotFoundError`, `UndecidedError`."""
    place = folder / p.folder
    if not isinstance(p.files, str):
        paths = [place / name for name in p.files]
        for path in paths:
            if not path.is_file():
                raise errors.DataNotFoundError(f"{path}: no such file; correct points.files or points.folder")
        return paths, None
    if not p.files or Path(p.files).is_absolute():
        raise errors.ConfigError(
            f"points.files = '{p.files}': give a pattern relative to points.folder, such as '*.csv'"
        )
    found = sorted(path for path in place.glob(p.files) if path.is_file())
    if len(found) + (p.reference == "separate") < 2:
        raise errors.DataNotFoundError(
            f"{place / p.files}: {len(found)} files; points.files must match the reference and at least one frame"
        )
    order = frame_order([path.stem for path in found], p.order)
    return [found[i] for i in order.index], order


def read_frames(p: PointsTable, folder: Path, mask: str | None = None) -> Frames:
    """All frames, matched point by point to the first. mask: a column of the reference table.

    Raises the errors of the tables, `LostPointsError`, `DegenerateMeshError`, `MeshMismatchError`.
    """
    paths, order = frame_files(p, folder)
    frames = list(frames_as_written(p, paths))
    if p.coordinates == "current":
        frames = [Frame(f.position - f.moved, f.moved, f.source) for f in frames]
    flags = None if mask is None else np.nan_to_num(read_columns(paths[0], [mask], p.text)[mask]) != 0
    known = np.isfinite(frames[0].position).all(axis=1)
    points = frames[0].position[known]
    if len(points) < 4:
        raise errors.LostPointsError(
            f"{frames[0].source}: {len(points)} points of the reference frame have a position; it must list every point, with u and v = 0"
        )
    _refuse_twice(points, np.flatnonzero(known), frames[0].source)
    moved = np.stack([_matched(points, frame) for frame in frames])
    if not np.isfinite(moved[p.reference != "separate" :]).any():
        raise errors.LostPointsError(_all_failed(p, paths))
    if not np.isfinite(moved[0]).any() and p.reference != "separate":
        moved[0] = 0.0  # displacements count from the reference, whatever its quality
    if p.reference != "separate" and len(moved) > 1 and not _is_at_rest(moved):
        raise errors.ConfigError(
            f"{frames[0].source}: the points have moved in the first file, by {motion(moved[0]):.3g} at the median, "
            f"{motion(moved[-1]):.3g} in the last; where displacements count from a picture without a file, set points.reference = 'separate'"
        )
    if p.reference == "separate":
        moved = np.concatenate([np.zeros_like(moved[:1]), moved])
    flagged = None if flags is None else flags[known]
    if points.shape[1] == 2:
        return Frames(points, moved, flagged, paths, order)
    plane = fitted_plane(points)
    inside, along = plane.coordinates(points), plane.components(moved)
    height = plane.components(points - plane.origin)[:, 2]
    heights = np.concatenate([height[None], height + along[1:, :, 2]])
    return Frames(inside, along[..., :2], flagged, paths, order, heights, plane)


def _refuse_twice(points: Array, rows: NDArray[np.int64], source: str) -> None:
    """Raises `DegenerateMeshError` for two of the points (n, 2 or 3), mm, at one place; rows (n,): of the file, from 0."""
    distance, near = cKDTree(points).query(points, k=2)
    distance = distance[:, 1]
    if not np.median(distance) > 0 or distance.min() < 1e-6 * np.median(distance):
        first = int(distance.argmin())
        one, other = sorted(rows[[first, near[first][near[first] != first][0]]] + 1)
        place = ", ".join(f"{x:.4g}" for x in points[first])
        raise errors.DegenerateMeshError(
            f"{source}: points are listed twice, as in rows {one} and {other} of its numbers, at {place} mm; export each point once"
        )


def _is_at_rest(moved: Array) -> bool:
    """Whether the first of displacements (t, n, 2 or 3) are no more than noise beside the last."""
    return not motion(moved[0]) > MOVED * motion(moved[-1])


def motion(displacements: Array) -> float:
    """Median length of displacements (n, 2 or 3), mm; 0 where all failed."""
    length = np.linalg.norm(displacements, axis=1)
    return float(np.median(length[np.isfinite(length)])) if np.isfinite(length).any() else 0.0


def frames_as_written(p: PointsTable, paths: list[Path]) -> Iterator[Frame]:
    """Frames in mm, y up (and z towards the observer, where y was turned)."""
    axes = np.array([1.0, -1.0, -1.0]) if p.y_axis == "down" else np.ones(3)
    of_position, of_displacement = p.scales
    if p.layout == "ncorr":
        for path in paths:
            position, frames = read_ncorr(path)
            for moved in frames:
                yield Frame(position * of_position * axes[:2], moved * of_displacement * axes[:2], str(path))
        return
    read = {"table": _table, "matrix": _matrices}[p.layout]
    for path in paths:
        position, moved = read(p, path)
        k = position.shape[1]
        yield Frame(position * of_position * axes[:k], moved * of_displacement * axes[:k], str(path))


def _table(p: PointsTable, path: Path) -> tuple[Array, Array]:
    """Position and displacement (k, 2 or 3) as written, NaN where a point failed."""
    where = [p.x, p.y] + ([p.z] if p.z else [])
    motion = [p.u, p.v] + ([p.w] if p.w else [])
    table = read_columns(path, [*where, *motion] + ([p.valid_column] if p.valid_column else []), p.text)
    position = np.stack([table[name] for name in where], axis=1)
    moved = np.stack([table[name] for name in motion], axis=1)
    if p.valid_column:
        failed = ~_valid(p, table[p.valid_column])
        moved[failed] = np.nan
        position[failed & _repeated(position)] = np.nan
    return position, moved


def _repeated(position: Array) -> Flags:
    """Points (k,) with the position of another one, such as 0, 0 of all that failed."""
    _, which, count = np.unique(np.nan_to_num(position), axis=0, return_inverse=True, return_counts=True)
    return np.asarray(count[which.ravel()] > 1)


def _valid(p: PointsTable, quality: Array) -> Flags:
    """Points (n,) whose quality (n,) is within the limits of the map."""
    low = -np.inf if p.valid_minimum is None else p.valid_minimum
    high = np.inf if p.valid_maximum is None else p.valid_maximum
    return np.isfinite(quality) & (quality >= low) & (quality <= high)


def _all_failed(p: PointsTable, paths: list[Path]) -> str:
    """What to say where no frame has a point."""
    if p.valid_column is None:
        if len(paths) == 1:
            return f"{paths[-1]}: the only frame has no displacement; a test needs the reference and a loaded picture, so export more frames"
        return f"{paths[-1]} and all others: no point has a displacement; check points.u and points.v"
    quality = np.concatenate([read_columns(path, [p.valid_column], p.text)[p.valid_column] for path in paths])
    found = f"from {np.nanmin(quality):g} to {np.nanmax(quality):g}" if np.isfinite(quality).any() else "no number"
    return (
        f"{paths[-1]} and all others: no point is valid; '{p.valid_column}' is {found}, check points.valid_minimum "
        f"({p.valid_minimum}) and valid_maximum ({p.valid_maximum})"
    )


def _matrices(p: PointsTable, path: Path) -> tuple[Array, Array]:
    """Position and displacement (k, 2) of matrices without header, one quantity a file; x along a row, y down the rows."""

    def matrix(ending: str) -> Array:
        other = path.with_name(path.name.replace(p.u, ending))
        return np.stack(list(read_table(other, None, p.text).values()), axis=1)

    u, v = matrix(p.u), matrix(p.v)
    rows, columns = np.indices(u.shape) * (p.step or 1.0)
    x, y = (matrix(p.x), matrix(p.y)) if p.x else (columns, rows)
    if not u.shape == v.shape == x.shape == y.shape:
        raise errors.MeshMismatchError(
            f"{path}: {u.shape} values, and {v.shape} in the file of '{p.v}'; export them again"
        )
    return np.stack([x.ravel(), y.ravel()], axis=1), np.stack([u.ravel(), v.ravel()], axis=1)


def _matched(points: Array, frame: Frame) -> Array:
    """Displacements (n, 2 or 3) at `points` of a frame listed in any order; NaN where it has no such point."""
    pitch = spacing_of(points)
    known = np.isfinite(frame.position).all(axis=1) & np.isfinite(frame.moved).all(axis=1)
    result = np.full(points.shape, np.nan)
    if not known.any():
        return result
    distance, index = cKDTree(points).query(frame.position[known])
    near = distance < 0.3 * pitch
    if near.mean() < 0.5:
        raise errors.MeshMismatchError(
            f"{frame.source}: {int((~near).sum())} of {near.size} points are not in the reference frame; if positions move "
            "with the specimen, set points.coordinates = 'current'"
        )
    found, times = np.unique(index[near], return_counts=True)
    if (times > 1).any():
        place = points[found[times > 1][0]]
        raise errors.DegenerateMeshError(
            f"{frame.source}: {int((times > 1).sum())} points are listed more than once, the first at {', '.join(f'{x:.4g}' for x in place)} mm; export each point once"
        )
    result[index[near]] = frame.moved[known][near]
    return result
