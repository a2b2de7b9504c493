"""A recorded test, frame by frame, before it becomes an Experiment.

In: `Series`: points, triangles, displacements of every frame, the machine's force record and what is gripped.
Out: an Experiment: frames chosen, forces interpolated to them, failed points left out, noise estimated,
every decision written into its provenance.

Time of frame k on the clock of the machine: k / frame rate + offset. The force is that of the grip ON the
specimen, along `direction` for each loaded boundary.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.data import points
from calibrate.data.experiment import Experiment, LoadedBoundary, Noise
from studies.importers.recording import noise_estimate
from studies.importers.recording.masks import Masked
from studies.importers.recording.notes import mask_notes, noise_notes, record_notes, strain_notes
from studies.importers.recording.outliers import outliers
from studies.importers.recording.synchronise import (
    DEFAULT_SELECTION,
    ForceRecord,
    Selection,
    choose_frames,
    find_break,
    forces_at,
)
from studies.output.words import Words

WORDS = Words("experiment")
Array = NDArray[np.float64]
Index = NDArray[np.int64]
UNSEEN = 0.02  # of the range of lengths, by which a specimen may have been longer than its chosen frames show


@dataclass(frozen=True)
class Grip:
    """A loaded boundary: nodes (k,), and the direction (2,) in which a tensile force pulls on it; 0 there means the
    component was not measured. record: of a load cell of its own. slides: held along the direction only, free of traction
    across it."""

    name: str
    nodes: Index
    direction: tuple[float, float]
    record: ForceRecord | None = None
    slides: bool = False

    @property
    def held(self) -> tuple[bool, bool]:
        """Components of the displacement that are prescribed."""
        x, y = self.direction
        return (x != 0, y != 0) if self.slides else (True, True)

    def force(self, force: Array) -> Array:
        """(t, 2) N of a force (t,) N that is positive in tension; NaN for what was not measured."""
        unknown = np.zeros(force.shape) if self.slides else np.full(force.shape, np.nan)
        return np.stack([unknown if d == 0 else d * force for d in self.direction], axis=1)


@dataclass(frozen=True)
class Series:
    """Every frame of a test. points (n, 2) mm, y up; triangles (m, 3); displacements (n_frames, n, 2) mm, NaN where
    a point failed; time (n_frames,) s on the clock of the machine; resolution (s) of that synchronisation. has_clock: False
    where times only number the frames. force_std: of the forces, N, where it is known; None: estimated from the record.
    masked (k, 2) mm: points left out before; tested: whether spurious points were looked for."""

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
    plane: str = "stress"
    has_clock: bool = True
    force_std: float | None = None
    provenance: dict[str, Any] = field(default_factory=dict)
    masked: Array = field(default_factory=lambda: np.zeros((0, 2)))
    tested: bool = False


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
    if len(series.grips) == 1:  # the other end may move along
        direction = np.array(series.grips[0].direction)
        along = series.points @ direction
        other = along <= along.min() + 0.1 * np.ptp(along)
        total -= np.nanmean(series.displacements[:, other], axis=1) @ direction
    return total


def to_experiment(
    series: Series,
    selection: Selection = DEFAULT_SELECTION,
    noise: Noise | None = None,
    noise_kind: str = "total",
) -> Experiment:
    """Turn a Series into an Experiment. noise: stated noise; None: estimated from all frames.

    noise_kind: 'total' or 'temporal', see `noise_estimate`. Raises `ConfigError`, `LostPointsError`,
    `MissingForceError`, `ForceSignError`, `TimeError`, `ExperimentError` where noise cannot be estimated, and whatever
    the checks of an Experiment find.
    """
    frames, notes = choose_frames(series.time, series.record, selection, _failure(series))
    tare = _at_rest(series, series.record) if selection.tare is None else selection.tare
    force = forces_at(series.record, series.time[frames]) - tare
    _check_sign(series, frames, force)
    loaded = tuple(_loaded(series, grip, frames, force) for grip in series.grips)
    notes += unseen_peak(elongation(series), frames)
    kept = points.drop_points(series.points, series.triangles, series.displacements[frames], loaded, series.free_nodes)
    if kept.lost.size:
        notes.append(WORDS.note_points_lost(lost=kept.lost.size, points=len(series.points)))
    noise, report = _noise_of(series, kept.indices, frames, noise, noise_kind)
    notes += record_notes(series.record) + noise_notes(report) + _spurious_notes(series, kept)
    provenance = {
        **series.provenance,
        "frames": frames.tolist(),
        "frames_recorded": len(series.time),
        "tare_N": tare,
        "points_lost": int(kept.lost.size),
        "noise": report,
        "notes": [*series.provenance.get("notes", []), *notes],
    }
    experiment = Experiment(
        name=series.name,
        points=kept.points,
        triangles=kept.triangles,
        displacements=kept.displacements,
        loaded=kept.loaded,
        free_nodes=kept.free_nodes,
        thickness=series.thickness,
        time=series.time[frames] if series.has_clock else None,
        noise=noise,
        provenance=provenance,
        plane=series.plane,
    )
    signal = experiment.strain_signal
    more = {"strain_signal": signal.to_dict(), "notes": [*provenance["notes"], *strain_notes(experiment)]}
    return replace(experiment, provenance={**provenance, **more})


def _noise_of(
    series: Series, nodes: Index, frames: Index, noise: Noise | None, kind: str
) -> tuple[Noise, dict[str, Any]]:
    """Stated or estimated noise."""
    if noise is None:
        return estimate_noise(series, nodes, frames, kind)
    return noise, {"kind": "stated"}


def _spurious_notes(series: Series, kept: points.Kept) -> list[str]:
    """Of spurious points, where an importer has not looked for them; they are kept."""
    if series.tested:
        return []
    none = np.zeros(len(kept.points), bool)
    spurious = none.copy()
    spurious[outliers(kept.points, kept.displacements).index] = True
    return mask_notes(kept.points, Masked(none, spurious, False), np.zeros((0, 2)))


def unseen_peak(lengths: Array, frames: Index) -> list[str]:
    """A note where the specimen was longer between chosen frames than in any chosen before. lengths (n_frames,): mm;
    frames (t,): those chosen."""
    known = np.where(np.isfinite(lengths), lengths, -np.inf)
    missed = np.maximum.accumulate(known)[frames] - np.maximum.accumulate(known[frames])
    worst = int(np.argmax(missed))
    if not missed[worst] > UNSEEN * np.ptp(lengths[np.isfinite(lengths)]):
        return []
    peak = int(np.argmax(known[: frames[worst] + 1]))
    return [WORDS.note_unseen_peak(peak=peak, longer=missed[worst], frame=frames[worst])]


def _at_rest(series: Series, record: ForceRecord) -> float:
    """Force of a record at frame 0, N."""
    rest = float(np.clip(series.time[0], record.time[0], record.time[-1]))
    return float(forces_at(record, np.array([rest]))[0])


def _loaded(series: Series, grip: Grip, frames: Index, force: Array) -> LoadedBoundary:
    """A grip with the force (t,), N, of the machine, or of its own load cell, whose zero is that of frame 0."""
    if grip.record is not None:
        force = forces_at(grip.record, series.time[frames]) - _at_rest(series, grip.record)
    return LoadedBoundary(grip.name, grip.nodes, grip.force(force), grip.held)


def _check_sign(series: Series, frames: Index, force: Array) -> None:
    """Tension must lengthen: compare the force with the distance between the grips."""
    if float(force @ elongation(series)[frames]) < 0:
        raise errors.ForceSignError(
            "the specimen lengthens while the force falls below zero; the force must be positive in tension: "
            "change its sign, or check which way the image's y-axis points"
        )


def estimate_noise(series: Series, nodes: Index, frames: Index, kind: str) -> tuple[Noise, dict[str, Any]]:
    """Noise of a series from all its frames, or from the chosen ones where too many points failed in the others.

    nodes (k,): those to be used; frames (t,): those chosen; kind: 'total' or 'temporal'. Beside the Noise (mm, N) its
    parts by name. Raises `ConfigError` for another kind, `ExperimentError` where points are too few or too scattered.
    """
    if kind not in ("total", "temporal"):
        raise errors.ConfigError(f"noise kind '{kind}' unknown; choose total or temporal")
    complete = nodes[np.isfinite(series.displacements[:, nodes]).all(axis=(0, 2))]
    enough = complete.size >= 0.6 * nodes.size
    displacements = series.displacements[:, complete] if enough else series.displacements[frames][:, nodes]
    found = noise_estimate.displacement_noise(series.points[complete if enough else nodes], displacements)
    force = forces_at(series.record, series.time[[0, *frames]])
    slope = float(np.abs(np.diff(force)).sum() / (series.time[frames[-1]] - series.time[0]))
    cell = series.force_std
    if cell is None:
        cell = noise_estimate.force_noise(series.record.time, series.record.force)
    chosen = found.temporal if kind == "temporal" and found.temporal is not None else found.total
    report = {
        "kind": kind,
        "from_frames": len(displacements),
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
