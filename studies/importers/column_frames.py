"""Frames of a column map: one text table each in, displacements at the points of the reference frame out, mm, y up."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibrate import errors
from studies.importers.column_map import PointsTable
from studies.importers.text_tables import Layout, read_table

Array = NDArray[np.float64]


def frame_paths(folder: Path, pattern: str) -> list[Path]:
    """Files of a pattern, sorted by the last number in their names. Raises `DataNotFoundError` for fewer than two."""
    found = [p for p in folder.glob(pattern) if p.is_file()]
    numbered = [([int(n) for n in re.findall(r"\d+", p.stem)][-1:] or [-1], str(p), p) for p in found]
    paths = [p for _, _, p in sorted(numbered)]
    if len(paths) < 2:
        raise errors.DataNotFoundError(
            f"{folder / pattern}: {len(paths)} files; points.files must match the reference and at least one frame"
        )
    return paths


def read_frames(p: PointsTable, paths: list[Path], mask: str | None) -> tuple[Array, Array, NDArray[np.bool_] | None]:
    """Reference points (n, 2) mm, displacements (n_frames, n, 2) mm (NaN = failed), and where the column `mask` is not 0 (n,)."""
    columns = [p.x, p.y, p.u, p.v] + ([p.valid_column] if p.valid_column else [])
    layout = Layout(p.delimiter, p.header_line, p.units_row, p.comment, missing_allowed=True)
    flags = None if mask is None else read_table(paths[0], [mask], layout)[mask]
    axes = np.array([1.0, -1.0 if p.y_axis == "down" else 1.0])
    of_position, of_displacement = p.scales
    frames = []
    for path in paths:
        table = read_table(path, columns, layout)
        position = np.stack([table[p.x], table[p.y]], axis=1) * of_position * axes
        moved = np.stack([table[p.u], table[p.v]], axis=1) * of_displacement * axes
        if p.valid_column:
            moved[~_valid(p, table[p.valid_column])] = np.nan
        frames.append((position - moved if p.coordinates == "current" else position, moved))
    points = frames[0][0]
    known = np.isfinite(points).all(axis=1)
    points = points[known]
    if len(points) < 4:
        raise errors.LostPointsError(
            f"{paths[0]}: {len(points)} points of the reference frame have a position; it must list every point, with u and v = 0"
        )
    distance = cKDTree(points).query(points, k=2)[0][:, 1]
    if distance.min() < 1e-6 * np.median(distance) or not np.median(distance) > 0:
        raise errors.DegenerateMeshError(f"{paths[0]}: points are listed twice; export each point once")
    displacements = np.stack([_matched(points, *frame, path) for frame, path in zip(frames, paths, strict=True)])
    if not np.isfinite(displacements[1:]).any():
        raise errors.LostPointsError(_all_failed(p, paths, layout))
    if not np.isfinite(displacements[0]).any():  # displacements count from the reference, whatever its quality
        displacements[0] = 0.0
    return points, displacements, None if flags is None else np.nan_to_num(flags[known]) != 0


def _valid(p: PointsTable, quality: Array) -> NDArray[np.bool_]:
    """Points (n,) whose quality (n,) is within the limits of the map."""
    low = -np.inf if p.valid_minimum is None else p.valid_minimum
    high = np.inf if p.valid_maximum is None else p.valid_maximum
    return np.isfinite(quality) & (quality >= low) & (quality <= high)


def _all_failed(p: PointsTable, paths: list[Path], layout: Layout) -> str:
    """What to say where no frame has a point."""
    if p.valid_column is None:
        return f"{paths[1]} and all later frames: no point has a displacement; check points.u and points.v"
    quality = np.concatenate([read_table(path, [p.valid_column], layout)[p.valid_column] for path in paths])
    found = f"from {np.nanmin(quality):g} to {np.nanmax(quality):g}" if np.isfinite(quality).any() else "no number"
    return (
        f"{paths[1]} and all later frames: no point is valid; '{p.valid_column}' is {found}, check points.valid_minimum "
        f"({p.valid_minimum}) and valid_maximum ({p.valid_maximum})"
    )


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
