"""From a recorded test to an Experiment.

In: `Series`: points, triangles, displacements of every frame, the machine's force record and what is gripped.
Out: an Experiment: frames chosen, forces interpolated to them, failed points left out, noise estimated,
every decision written into its provenance.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.data import points
from calibrate.data.continued_rims import WithRims, with_continued_rims
from calibrate.data.experiment import Experiment, LoadedBoundary, Noise
from studies.importers.masking.masks import Masked
from studies.importers.masking.outliers import outliers
from studies.importers.recording.grip_motion import (
    clock_notes,
    clocks,
    elongation,
    failure,
    looks_incremental,
    moves_across,
    unseen_peak,
)
from studies.importers.recording.notes import (
    mask_notes,
    noise_notes,
    numbers,
    preload_notes,
    record_notes,
    repeated_frame_notes,
    strain_notes,
)
from studies.importers.recording.recorded_series import Grip, Series
from studies.importers.recording.series_noise import noise_of
from studies.importers.recording.stated_noise import StatedNoise
from studies.importers.recording.synchronise import DEFAULT_SELECTION, Selection, choose_frames, forces_at
from studies.importers.recording.whole_record import ROUNDING, at_rest, whole_record
from studies.output.words import Words

__all__ = ["Grip", "Series", "to_experiment"]
WORDS = Words("experiment")
OPPOSED = 0.25  # of the largest force and elongation, from which their signs must be alike
Array = NDArray[np.float64]
Index = NDArray[np.int64]


def to_experiment(
    series: Series,
    selection: Selection = DEFAULT_SELECTION,
    noise: Noise | StatedNoise | None = None,
    noise_kind: str = "total",
) -> Experiment:
    """Turn a Series into an Experiment. noise: as far as it is stated; the rest is estimated from all frames.

    noise_kind: 'total' or 'temporal', see `noise_estimate`. Raises `ConfigError`, `LostPointsError`,
    `MissingForceError`, `ForceSignError`, `TimeError`, `ExperimentError` where noise cannot be estimated, and whatever
    the checks of an Experiment find.
    """
    broke = failure(series)
    frames, notes = _frames(series, selection, broke)
    tare = at_rest(series, series.record) if selection.tare is None else selection.tare
    force = forces_at(series.record, series.time[frames]) - tare
    loaded = tuple(_loaded(series, grip, frames, force) for grip in series.grips)
    notes += _motion_notes(series, frames, force)
    kept = points.drop_points(series.points, series.triangles, series.displacements[frames], loaded, series.free_nodes)
    if kept.lost.size > series.lone:
        notes.append(WORDS.note_points_lost(lost=kept.lost.size - series.lone, points=len(series.points)))
    rims = with_continued_rims(kept, series.rims, series.fits_holes)
    notes += _rim_notes(rims)
    found, report = _noise_of(series, kept.indices, frames, noise, noise_kind)
    start = series.start(int(frames[0]))
    record, thinned = whole_record(series, tare, broke, start)
    compared = clocks(series, report.get("synchronisation_std_s", 0.0))
    notes += thinned + clock_notes(compared)
    notes += _force_notes(series, selection, tare, force) + noise_notes(report) + _spurious_notes(series, kept)
    provenance = {
        **series.provenance,
        "frames": frames.tolist(),
        "frames_recorded": len(series.time),
        "start_s": start,
        "tare_N": tare,
        "zeroed": selection.tare is None,
        "clocks": None if compared is None else {**asdict(compared), "agree": compared.agree},
        "points_lost": int(kept.lost.size) - series.lone,
        "rims": [found.to_dict() for found in rims.rims],
        "noise": report,
        "notes": [*series.provenance.get("notes", []), *notes],
    }
    experiment = Experiment(
        name=series.name,
        points=rims.kept.points,
        triangles=rims.kept.triangles,
        displacements=rims.kept.displacements,
        loaded=rims.kept.loaded,
        free_nodes=rims.kept.free_nodes,
        thickness=series.thickness,
        time=series.time[frames] - start if series.has_clock else None,
        noise=found,
        provenance=provenance,
        plane=series.plane,
        heights=None if series.heights is None else rims.with_continued(series.heights[np.concatenate([[0], frames])]),
        record=record,
        continued=rims.continued,
    )
    return _with_strain_notes(experiment)


def _rim_notes(rims: WithRims) -> list[str]:
    """Of edges that points were continued to, and of those that are open."""
    continued = [WORDS.note_rim_continued(found=found, told=found.to_dict()) for found in rims.rims]
    return continued + ([WORDS.note_left_open(places=rims.left_open)] if rims.left_open else [])


def _with_strain_notes(experiment: Experiment) -> Experiment:
    """With the size of the strain in its provenance, and what is to be said of it."""
    found = experiment.provenance
    notes = [*found["notes"], *strain_notes(experiment)]
    return replace(
        experiment, provenance={**found, "strain_signal": experiment.strain_signal.to_dict(), "notes": notes}
    )


def _frames(series: Series, selection: Selection, broke: float | None) -> tuple[Index, list[str]]:
    """Frames that become increments, and notes on what was left out."""
    frames, notes = choose_frames(series.time, series.record, selection, broke, failed_frames(series))
    frames, beyond = _read_by_all(series, frames)
    notes += beyond
    if selection.frames is not None or selection.count is not None:
        return frames, notes
    frames, left_out = bridged_frames(series, frames)
    return frames, notes + left_out


def _read_by_all(series: Series, frames: Index) -> tuple[Index, list[str]]:
    """Of the frames (t,) those at which every load cell has a reading, and a note on those beyond a record. Raises `MissingForceError` where none is left."""
    cells = [grip.record for grip in series.grips if grip.record is not None]
    if not cells:
        return frames, []
    start, end = max(cell.time[0] for cell in cells), min(cell.time[-1] for cell in cells)
    time = series.time[frames]
    inside = (time >= start - ROUNDING) & (time <= end + ROUNDING)
    read = inside & ~np.isin(frames, np.concatenate([cell.unread for cell in cells]))
    if not read.any():
        raise errors.MissingForceError(
            f"no frame has a force of every load cell: all of them read from {start:g} to {end:g} s, the frames are from {time[0]:g} to {time[-1]:g} s; check the clocks of the load cells"
        )
    beyond = frames[~inside].tolist()
    return frames[read], [WORDS.note_beyond_record(frames=beyond, start=start, end=end)] if beyond else []


def _force_notes(series: Series, selection: Selection, tare: float, force: Array) -> list[str]:
    """Of readings without a force, and of the one at the reference picture, where that is taken as zero."""
    cells = [grip.record for grip in series.grips if grip.record is not None] or [series.record]
    blank = [note for cell in cells for note in record_notes(cell)]
    return blank + (preload_notes(tare, force) if selection.tare is None else [])


def _motion_notes(series: Series, frames: Index, force: Array) -> list[str]:
    """Of grips that move across the pull, of a peak between the frames, and of increments from frame to frame. Raises `ForceSignError`."""
    across, notes = moves_across(series, frames), list[str]()
    if across is None:
        _check_sign(series, frames, force)
    else:
        notes.append(WORDS.note_moves_across(along=across[0], across=across[1]))
    notes += unseen_peak(elongation(series), frames) + repeated_frame_notes(series.displacements, frames)
    return notes + ([WORDS.note_incremental()] if looks_incremental(series) else [])


def failed_frames(series: Series) -> Index:
    """Frames with more failed points than can be bridged."""
    lost = 1 - np.isfinite(series.displacements).all(axis=2).mean(axis=1)
    return np.flatnonzero(lost > points.MAX_LOST)


def bridged_frames(series: Series, frames: Index) -> tuple[Index, list[str]]:
    """Of the frames (t,) those whose failed points can be left out of all of them, and a note on the others: a few in which a point of a grip
    failed; then those with most failed points, until what fails in any of the rest can be bridged."""
    failed = ~np.isfinite(series.displacements[frames]).all(axis=2)
    held = failed[:, np.unique(np.concatenate([grip.nodes for grip in series.grips]))].any(axis=1)
    kept = ~held if held.mean() <= points.MAX_LOST else np.ones(len(frames), bool)
    order = np.flatnonzero(kept)[np.argsort(failed[kept].sum(axis=1), kind="stable")]
    lost = np.maximum.accumulate(failed[order], axis=0).mean(axis=1)
    kept[order[lost > points.MAX_LOST]] = False
    if kept.all():
        return frames, []
    return frames[kept], [WORDS.note_unbridged_frames(frames=numbers(frames[~kept].tolist()), kept=int(kept.sum()))]


def _noise_of(
    series: Series, nodes: Index, frames: Index, noise: Noise | StatedNoise | None, kind: str
) -> tuple[Noise, dict[str, Any]]:
    """Stated or estimated noise."""
    stated = StatedNoise.all_of(noise) if isinstance(noise, Noise) else noise or StatedNoise()
    return noise_of(series, nodes, frames, stated, kind)


def _spurious_notes(series: Series, kept: points.Kept) -> list[str]:
    """Of spurious points, where an importer has not looked for them; they are kept."""
    if series.tested:
        return []
    none = np.zeros(len(kept.points), bool)
    spurious = none.copy()
    spurious[outliers(kept.points, kept.displacements).index] = True
    return mask_notes(kept.points, Masked(none, spurious, False), np.zeros((0, 2)))


def _loaded(series: Series, grip: Grip, frames: Index, force: Array) -> LoadedBoundary:
    """A grip with the force (t,), N, of the machine, or of its own load cell, whose zero is that of frame 0."""
    if grip.record is not None:
        force = forces_at(grip.record, series.time[frames]) - at_rest(series, grip.record)
    return LoadedBoundary(grip.name, grip.nodes, grip.force(force), grip.held)


def _check_sign(series: Series, frames: Index, force: Array) -> None:
    """Tension must lengthen: compare the force with the distance between the grips, in all pictures and in each."""
    longer = elongation(series)[frames]
    if float(force @ longer) < 0:
        raise errors.ForceSignError(
            "the specimen lengthens while the force falls below zero; the force must be positive in tension: "
            "change its sign, or check which way the image's y-axis points and which sides are loaded"
        )
    turned = (force / np.abs(force).max() < -OPPOSED) & (longer / np.abs(longer).max() > OPPOSED)
    if turned.any():
        raise errors.ForceSignError(
            f"{series.record.source}: the force of picture {numbers(frames[turned].tolist())} is far below zero while the specimen is longer than at rest, that of the others is not; "
            "correct its sign, or leave these pictures out"
        )
