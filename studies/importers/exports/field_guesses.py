"""What the measured field itself says: whether its reference has a file, its grid, which way it was pulled.

In: frames, as a column map reads them. Out: entries and facts of a column map, or the question which sides are loaded.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibrate import errors
from meshes.mesh import spacing_of
from studies.importers.exports.guesses import Guesses
from studies.importers.frame_tables import Frames, frame_files, frames_as_written, motion
from studies.importers.map_tables import PointsTable
from studies.importers.masking.masks import SIDES

Array = NDArray[np.float64]
STILL = 1e-9  # of the distance of the points: a displacement that is zero but for rounding
SLIGHT = 1e-3  # of the later motion, up to which motion is no load
ROUGH, AROUND = 3.0, 8  # times the scatter about so many neighbours, up to which it is noise
STRAINED, SIGNIFICANT = 1e-4, 10.0  # least strain, and least ratio of it to its standard error, that tell the pull
USUAL_DEPTH, DEEPEST, SPANNED = 0.4, 4.0, 0.95  # of a side: spacings, spacings, share of the section
AGREEING, DECIDED = 0.02, 0.1  # spacings, and share of the other distance, below which positions agree
INNER = 5, 95  # percentiles of displacements, whose difference is how far points move against each other
PULLED = ["left", "right"], ["bottom", "top"]  # sides that are loaded along x, along y
LEAST_POINTS = 4  # of a frame, for mean strains with an error
ALIKE = 0.6  # of the larger strain, from which the smaller of equal sign makes the pull undecided


def has_rest(frames: Frames) -> bool:
    """Whether the first file is the reference itself: most of its points have not moved, or no further than noise or next to nothing.

    Noise is rough, a load is smooth: motion is compared with how far points are from the mean of their neighbours.
    """
    moved, *later = (motion(u) for u in frames.displacements)
    if moved < STILL * pitch(frames.points) or moved < SLIGHT * max(later, default=0.0):
        return True
    known = np.isfinite(frames.displacements[0]).all(axis=1)
    points, u = frames.points[known], frames.displacements[0][known]
    near = cKDTree(points).query(points, k=min(AROUND + 1, len(points)))[1][:, 1:]
    return moved < ROUGH * motion(u - u[near].mean(axis=1))


def say_reference(frames: Frames, found: Guesses) -> bool:
    """Whether the reference picture has no file, as the first that has one is loaded."""
    first, separate = frames.displacements[0], not has_rest(frames)
    by = f"by {motion(first):.2g} {_shown_unit(found)} at the median"
    if separate:
        why = f"the points have moved in the first file, {by}: the reference picture has none"
        found.say("points.reference", "separate", why)
    elif np.nanmax(np.abs(first), initial=0.0) > STILL * pitch(frames.points):
        found.facts.append(f"the first file is the reference: its points have moved {by}, which is no load")
    else:
        found.facts.append("the first file is the reference: no point has moved in it")
    return separate


def pitch(points: Array) -> float:
    """Median distance of neighbours, mm."""
    return spacing_of(points)


def say_coordinates(p: PointsTable, found: Guesses) -> None:
    """Whether positions are those of the reference or move with the specimen, by the first and the last file."""
    paths, _ = frame_files(p, Path())
    if p.layout == "ncorr" or not p.x or len(paths) < 2:
        return
    first, last = frames_as_written(p, [paths[0], paths[-1]])
    still = _apart(first.position, last.position)
    moving = _apart(first.position - first.moved, last.position - last.moved)
    near = AGREEING * pitch(first.position[np.isfinite(first.position).all(axis=1)])
    if still < min(near, DECIDED * moving) and p.coordinates == "current":
        found.say("points.coordinates", "reference", "the first and the last file list the same positions")
    elif moving < min(near, DECIDED * still) and p.coordinates == "reference":
        why = "positions of the first and the last file agree once their displacements are subtracted"
        found.say("points.coordinates", "current", why)


def _apart(points: Array, others: Array) -> float:
    """Median distance of points (k, 2 or 3) to the nearest of others (m, 2 or 3); infinite where none are known."""
    known, near = (p[np.isfinite(p).all(axis=1)] for p in (points, others))
    return float(np.median(cKDTree(known).query(near)[0])) if len(known) and len(near) else float("inf")


def say_grid(frames: Frames, found: Guesses) -> None:
    """Number, spacing and regularity of the points, and how many failed."""
    spacing = pitch(frames.points)
    on_grid = all(_regular(np.unique(frames.points[:, k].round(6)), spacing) for k in range(2))
    size = np.ptp(frames.points, axis=0)
    kind = "regular grid" if on_grid else "scattered points"
    unit = _shown_unit(found)
    found.facts.append(
        f"{len(frames.points)} points, {size[0]:.4g} x {size[1]:.4g} {unit}, {kind}, spacing {spacing:.4g} {unit}"
    )
    failed = ~np.isfinite(frames.displacements).all(axis=2)
    if failed.any():
        found.facts.append(f"failed points: up to {int(failed.sum(axis=1).max())} in a frame")
    if frames.plane is not None:
        tilt, warp = frames.plane.tilt, frames.plane.warp
        assert frames.heights is not None
        moved = np.nanmean(frames.heights, axis=1)
        found.facts.append(
            f"stereo: fitted plane, tilt {tilt:.2g} degrees, warp {warp:.2g} mm rms; out-of-plane motion up to {np.abs(moved).max():.2g} mm on the mean"
        )


def _shown_unit(found: Guesses) -> str:
    """Of lengths in the facts: mm, once everything is known."""
    asked = {q.option for q in found.questions}
    return "units" if "--unit" in asked else "px" if "--scale" in asked else "mm"


def _regular(values: Array, spacing: float) -> bool:
    steps = np.diff(values)
    return len(steps) > 0 and bool(np.all(np.abs(steps / spacing - np.round(steps / spacing)) < 0.05))


def say_edges(frames: Frames, loaded: Sequence[str], free: Sequence[str], found: Guesses) -> None:
    """Loaded sides, as given or along the pull; free sides only as given. Raises `ConfigError` for loaded sides that are across the pull."""
    axis, why = pull_axis(frames)
    sides = None if axis is None else PULLED[axis]
    if loaded:
        if axis is not None and not set(PULLED[axis]) & set(loaded) and _lengthens(frames, axis):
            raise errors.ConfigError(
                f"--loaded {','.join(loaded)}: the specimen lengthens along the other axis and shortens along this one ({why}); is it --loaded {','.join(PULLED[axis])}? "
                "If not, write the sides in a column map"
            )
        found.say("edges.loaded", list(loaded), "as given")
    else:
        if sides is not None and set(sides) & set(free):
            why, sides = f"{' and '.join(sides)} by the pull, but --free names {' and '.join(free)}; {why}", None
        if sides is None:
            found.ask("edges.loaded", "--loaded", f"which sides are gripped ({why}), such as left,right")
        else:
            found.say("edges.loaded", sides, why)
    _say_tolerance(frames.points, found)
    if free:
        found.say("edges.free", list(free), "as given")
    else:
        found.facts.append(
            "no side counts as traction-free: whether the points reach the edges of the specimen is not stated (--free)"
        )


def _lengthens(frames: Frames, axis: int) -> bool:
    """Whether the frame that is deformed most is longer along this axis, and shorter along the other one."""
    strain, _ = mean_strains(frames.points, frames.displacements[_most_deformed(frames)])
    return bool(strain[axis] > 0 > strain[1 - axis])


def _most_deformed(frames: Frames) -> int:
    """Number of the frame, of those with enough points."""
    known = np.isfinite(frames.displacements).all(axis=2)
    seen = np.flatnonzero(known.sum(axis=1) >= LEAST_POINTS)
    inner = [np.percentile(frames.displacements[i][known[i]], INNER, axis=0) for i in seen]  # a wild point says nothing
    return int(seen[np.argmax(np.ptp(inner, axis=1).max(axis=1))])


def _say_tolerance(points: Array, found: Guesses) -> None:
    """How deep the outermost row is where it is not parallel to the axes: so that a loaded side spans the section."""
    depths = [_depth(points, side) for side in found.get("edges.loaded") or ()]
    wide = max((depth for depth in depths if depth is not None), default=0.0)
    if wide > USUAL_DEPTH and None not in depths:
        why = "the outermost rows are not parallel to the axes; so deep they span the section"
        found.say("edges.tolerance_mm", round(wide * pitch(points), 6), why)


def _depth(points: Array, side: str) -> float | None:
    """Distance from the outermost point, in spacings, within which points span the section; None where that is more than `DEEPEST`."""
    axis, sign = SIDES[side]
    inwards = (sign * points[:, axis]).max() - sign * points[:, axis]
    across, spacing = points[:, 1 - axis], pitch(points)
    for depth in np.arange(USUAL_DEPTH, DEEPEST, 0.1):
        if np.ptp(across[inwards <= depth * spacing]) >= SPANNED * np.ptp(across):
            return float(depth)
    return None


def pull_axis(frames: Frames) -> tuple[int | None, str]:
    """0 or 1: x or y, along which the mean strain is largest in the frame of those with enough points that is deformed most, as a test may end where it began;
    None where that is not decided, and why."""
    known = np.isfinite(frames.displacements).all(axis=2)
    if not (known.sum(axis=1) >= LEAST_POINTS).any():
        return None, f"no frame has {LEAST_POINTS} points with a displacement"
    most = _most_deformed(frames)
    strain, error = mean_strains(frames.points, frames.displacements[most])
    larger = int(np.argmax(np.abs(strain)))
    text = f"mean strains {100 * strain[0]:.3g} % along x, {100 * strain[1]:.3g} % along y in frame {most + 1}, where points move most against each other"
    if not abs(strain[larger]) > max(STRAINED, SIGNIFICANT * error[larger]):
        return None, f"no significant strain: {text}"
    if strain[1 - larger] / strain[larger] > ALIKE:
        return None, f"pulled along both axes: {text}"
    return larger, text


def mean_strains(points: Array, displacement: Array) -> tuple[Array, Array]:
    """du/dx and dv/dy of a linear fit to a frame (n, 2), and their standard errors."""
    known = np.isfinite(displacement).all(axis=1)
    design = np.column_stack([np.ones(known.sum()), points[known] - points[known].mean(axis=0)])
    fit, *_ = np.linalg.lstsq(design, displacement[known], rcond=None)
    scatter = (displacement[known] - design @ fit).std(axis=0)
    spread = np.sqrt(np.diag(np.linalg.inv(design.T @ design)))[1:]
    return np.array([fit[1, 0], fit[2, 1]]), scatter * spread
