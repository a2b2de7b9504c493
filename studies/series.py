"""A recorded test, frame by frame, before it becomes an Experiment.

In: `Series`: points, triangles, displacements of every frame, the machine's force record and what is gripped.
Out: an Experiment: frames chosen, forces interpolated to them, failed points left out, noise estimated,
every decision written into its provenance.

Time of frame k on the clock of the machine: k / frame rate + offset. The force is that of the grip ON the
specimen, along `direction` for each loaded boundary.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate import errors, points
from calibrate.experiment import Experiment, LoadedBoundary, Noise
from studies import noise_estimate

Array = NDArray[np.float64]
Index = NDArray[np.int64]
BREAK_LEVEL, BREAK_DURATION = 0.5, 0.05


@dataclass(frozen=True)
class ForceRecord:
    """Load-cell record: time (n,) s, increasing; force (n,) N, positive in tension; source: for messages."""

    time: Array
    force: Array
    source: str = "force record"

    def __post_init__(self) -> None:
        if len(self.time) < 2 or self.time.shape != self.force.shape:
            raise errors.MissingForceError(f"{self.source}: needs at least two readings of time and force")
        known = np.isfinite(self.force)
        if not known.any():
            raise errors.MissingForceError(f"{self.source}: contains no force")
        object.__setattr__(self, "force", self.force[known])
        object.__setattr__(self, "time", self.time[known])
        backwards = ~(np.diff(self.time) > 0)
        if backwards.any() or not np.isfinite(self.time).all():
            row = int(np.flatnonzero(backwards)[0]) + 1 if backwards.any() else 0
            raise errors.TimeError(
                f"{self.source}: time does not increase at reading {row + 1} ({self.time[row]:g} s after "
                f"{self.time[row - 1]:g} s); sort the record or remove repeated readings"
            )


@dataclass(frozen=True)
class Grip:
    """A loaded boundary: nodes (k,), and the direction (2,) in which a tensile force pulls on it; 0 there means the
    component was not measured."""

    name: str
    nodes: Index
    direction: tuple[float, float]


@dataclass(frozen=True)
class Series:
    """Every frame of a test. points (n, 2) mm, y up; triangles (m, 3); displacements (n_frames, n, 2) mm, NaN where
    a point failed; time (n_frames,) s on the clock of the machine; resolution (s) of that synchronisation."""

    name: str
    points: Array
    triangles: Index
    displacements: Array
    time: Array
    record: ForceRecord
    grips: tuple[Grip, ...]
    free_nodes: Index
    thickness: float | None = None
    synchronisation_std: float = 0.0
    provenance: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Selection:
    """Which frames become increments: `count` spread evenly over the time from the onset of loading to `until` (s;
    None: the last frame with a force), or an explicit list. onset: fraction of the largest force.
    tare: force in N taken as zero; None: the force at frame 0, since displacements count from there."""

    count: int = 12
    frames: tuple[int, ...] | None = None
    until: float | None = None
    onset: float = 0.01
    tare: float | None = None

    def __post_init__(self) -> None:
        if self.count < 1:
            raise errors.ConfigError(f"number of frames {self.count}: at least 1 is needed")
        if not 0 <= self.onset < 1:
            raise errors.ConfigError(
                f"onset {self.onset} is a fraction of the largest force, from 0 to below 1"
            )


def find_break(record: ForceRecord) -> tuple[float, float] | None:
    """Times (s) of the last reading before the force collapses and of the first after; None where it does not.

    A collapse is a fall below half of the largest force so far within 5 % of the record's duration, from which
    the force does not come back. Slow unloading, relaxation and cycles are none.
    """
    t, F = record.time, record.force - record.force[0]
    top = np.maximum.accumulate(F)
    fallen = (F < BREAK_LEVEL * top) & (top > 0.2 * F.max())
    if not fallen[-1]:
        return None
    first = int(np.flatnonzero(~fallen)[-1]) + 1
    start = int(np.flatnonzero(F[:first] >= 0.95 * top[first])[-1])
    if t[first] - t[start] > BREAK_DURATION * (t[-1] - t[0]):
        return None
    return float(t[start]), float(t[first])


def _failure(series: Series) -> float | None:
    """Time (s) of the last reading before a break: the force collapses, the distance of the grips does not."""
    found = find_break(series.record)
    if found is None:
        return None
    length = np.interp(found, series.time, elongation(series))
    return None if length[1] < 0.9 * length[0] else found[0]


def elongation(series: Series) -> Array:
    """Change of the distance between the grips along the pull (n_frames,), mm."""
    total = np.zeros(len(series.time))
    for grip in series.grips:
        total += np.nanmean(series.displacements[:, grip.nodes], axis=1) @ np.array(grip.direction)
    return total


def choose_frames(
    time: Array, record: ForceRecord, selection: Selection, broke: float | None = None
) -> tuple[Index, list[str]]:
    """Frame numbers that become increments, and notes on what was left out. broke: time of a failure, s.

    Raises `ConfigError` for frames outside the record, `MissingForceError` when no frame has a force.
    """
    notes: list[str] = []
    end = min(float(time[-1]), float(record.time[-1]))
    if broke is not None and broke < end:
        end = broke
        notes.append(f"force falls abruptly after {broke:.2f} s: later frames are left out as failure")
    if selection.frames is not None:
        return _explicit(time, record, selection.frames), notes
    if selection.until is not None:
        if selection.until > end + 1e-9:
            notes.append(f"--until {selection.until:g} s lies after the last usable frame ({end:.2f} s)")
        end = min(end, selection.until)
    force = forces_at(record, np.clip(time, record.time[0], record.time[-1]))
    usable = np.flatnonzero((time >= record.time[0]) & (time <= end + 1e-9) & (np.arange(len(time)) > 0))
    if usable.size == 0:
        raise errors.MissingForceError(
            f"no frame has a force: frames run from {time[0]:g} to {time[-1]:g} s, the force record from "
            f"{record.time[0]:g} to {record.time[-1]:g} s; check frame rate and offset"
        )
    level = selection.onset * np.abs(force[usable] - force[0]).max()
    loaded = usable[np.abs(force[usable] - force[0]) > level]
    if loaded.size == 0:
        raise errors.MissingForceError("the force does not change over the frames; check the synchronisation")
    targets = np.linspace(time[loaded[0]], time[usable[-1]], selection.count + 1)[1:]
    return np.unique([usable[np.argmin(np.abs(time[usable] - t))] for t in targets]), notes


def _explicit(time: Array, record: ForceRecord, frames: tuple[int, ...]) -> Index:
    chosen = np.array(frames, dtype=np.int64)
    if chosen.size == 0 or (np.diff(chosen) <= 0).any() or chosen[0] < 1 or chosen[-1] >= len(time):
        raise errors.ConfigError(
            f"frames {list(frames)}: give increasing numbers from 1 to {len(time) - 1} (0 is rest)"
        )
    outside = (time[chosen] < record.time[0]) | (time[chosen] > record.time[-1])
    if outside.any():
        raise errors.MissingForceError(
            f"frame {chosen[outside][0]} at {time[chosen[outside][0]]:.2f} s has no force; the record runs from "
            f"{record.time[0]:g} to {record.time[-1]:g} s"
        )
    return chosen


def forces_at(record: ForceRecord, time: Array) -> Array:
    """Force (k,) N at times (k,) s within the record, by linear interpolation."""
    return np.interp(time, record.time, record.force)


def to_experiment(
    series: Series, selection: Selection = Selection(), noise: Noise | None = None, noise_kind: str = "total"
) -> Experiment:
    """Turn a Series into an Experiment. noise: stated noise; None: estimated from all frames.

    noise_kind: 'total' or 'temporal', see `noise_estimate`. Raises `LostPointsError`, `MissingForceError`,
    `ForceSignError`, `TimeError`, and whatever the checks of an Experiment find.
    """
    frames, notes = choose_frames(series.time, series.record, selection, _failure(series))
    rest = float(np.clip(series.time[0], series.record.time[0], series.record.time[-1]))
    tare = float(forces_at(series.record, np.array([rest]))[0]) if selection.tare is None else selection.tare
    force = forces_at(series.record, series.time[frames]) - tare
    _check_sign(series, frames, force)
    loaded = tuple(
        LoadedBoundary(g.name, g.nodes, np.stack([_component(force, d) for d in g.direction], axis=1))
        for g in series.grips
    )
    kept = points.drop_points(
        series.points, series.triangles, series.displacements[frames], loaded, series.free_nodes
    )
    if kept.lost.size:
        notes.append(
            f"{kept.lost.size} of {len(series.points)} points failed in a chosen frame and were left out"
        )
    report: dict[str, Any] = {"kind": "stated"}
    if noise is None:
        noise, report = estimate_noise(series, kept.indices, frames, noise_kind)
    provenance = {
        **series.provenance,
        "frames": frames.tolist(),
        "frames_recorded": len(series.time),
        "tare_N": tare,
        "points_lost": int(kept.lost.size),
        "noise": report,
        "notes": [*series.provenance.get("notes", []), *notes],
    }
    return Experiment(
        name=series.name,
        points=kept.points,
        triangles=kept.triangles,
        displacements=kept.displacements,
        loaded=kept.loaded,
        free_nodes=kept.free_nodes,
        thickness=series.thickness,
        time=series.time[frames],
        noise=noise,
        provenance=provenance,
    )


def _component(force: Array, direction: float) -> Array:
    return np.full(force.shape, np.nan) if direction == 0 else direction * force


def _check_sign(series: Series, frames: Index, force: Array) -> None:
    """Tension must lengthen: compare the force with the distance between the grips."""
    if float(force @ elongation(series)[frames]) < 0:
        raise errors.ForceSignError(
            "the specimen lengthens while the force falls below zero; the force must be positive in tension: "
            "change its sign, or check which way the image's y-axis points"
        )


def estimate_noise(series: Series, nodes: Index, frames: Index, kind: str) -> tuple[Noise, dict[str, Any]]:
    """Noise of a series from all its frames, or from the chosen ones where too many points failed in the others."""
    if kind not in ("total", "temporal"):
        raise errors.ConfigError(f"noise kind '{kind}' unknown; choose total or temporal")
    complete = nodes[np.isfinite(series.displacements[:, nodes]).all(axis=(0, 2))]
    enough = complete.size >= 0.6 * nodes.size
    displacements = series.displacements[:, complete] if enough else series.displacements[frames][:, nodes]
    found = noise_estimate.displacement_noise(series.points[complete if enough else nodes], displacements)
    force = forces_at(series.record, series.time[[0, *frames]])
    slope = float(np.abs(np.diff(force)).sum() / (series.time[frames[-1]] - series.time[0]))
    cell = noise_estimate.force_noise(series.record.time, series.record.force)
    chosen = found.temporal if kind == "temporal" and found.temporal is not None else found.total
    report = {
        "kind": kind,
        "from_frames": int(len(displacements)),
        **found.to_dict(),
        "load_cell_std_N": cell,
        "synchronisation_std_s": series.synchronisation_std,
        "force_rate_N_per_s": slope,
    }
    noise = Noise(
        chosen.std,
        chosen.correlation_length,
        0.0,
        float(np.hypot(cell, slope * series.synchronisation_std)),
    )
    return noise, report
