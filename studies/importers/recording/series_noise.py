"""Noise of a recorded test: as far as it is stated, the rest estimated from all its frames and its force record."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.data.experiment import Noise
from studies.importers.recording import noise_estimate
from studies.importers.recording.grip_motion import elongation
from studies.importers.recording.load_cell_noise import force_noise
from studies.importers.recording.recorded_series import Series
from studies.importers.recording.stated_noise import StatedNoise
from studies.importers.recording.synchronise import forces_at

Index = NDArray[np.int64]


def noise_of(
    series: Series, nodes: Index, frames: Index, stated: StatedNoise, kind: str
) -> tuple[Noise, dict[str, Any]]:
    """Noise of a series, mm and N: what is stated, and of the rest what is estimated from all frames.

    nodes (k,): those to be used; frames (t,): those chosen; kind: 'total' or 'temporal'. Beside the Noise a report that says of
    displacements and forces which was done, with the parts of an estimate by name. Raises `ConfigError` for another kind,
    `ExperimentError` where points are too few or too scattered.
    """
    if kind not in ("total", "temporal"):
        raise errors.ConfigError(f"noise kind '{kind}' unknown; choose total or temporal")
    report: dict[str, Any] = {"displacement": "stated", "force": "stated"}
    displacement, force = stated.of_displacements, stated.of_forces
    if displacement is None:
        displacement, more = _estimated_displacement_noise(series, nodes, frames, kind)
        report |= {"displacement": kind, **more}
    if force is None:
        force, more = _estimated_force_noise(series, frames)
        report |= more
    return Noise(*displacement, *force, *stated.between_pictures), report


def _estimated_displacement_noise(
    series: Series, nodes: Index, frames: Index, kind: str
) -> tuple[tuple[float, float], dict[str, Any]]:
    """Standard deviation and correlation length, mm, from all frames, or from the chosen ones where too many points failed in the
    others; and all that was found."""
    complete = nodes[np.isfinite(series.displacements[:, nodes]).all(axis=(0, 2))]
    enough = complete.size >= 0.6 * nodes.size
    displacements = series.displacements[:, complete] if enough else series.displacements[frames][:, nodes]
    found = noise_estimate.displacement_noise(series.points[complete if enough else nodes], displacements)
    chosen = found.temporal if kind == "temporal" and found.temporal is not None else found.total
    return (chosen.std, chosen.correlation_length), {"from_frames": len(displacements), **found.to_dict()}


def _estimated_force_noise(series: Series, frames: Index) -> tuple[tuple[float, float], dict[str, Any]]:
    """Relative standard deviation (0) and that in N, of the load cell and of the synchronisation; and what they are made of."""
    force = forces_at(series.record, series.time[[0, *frames]])
    slope = float(np.abs(np.diff(force)).sum() / (series.time[frames[-1]] - series.time[0]))
    std = series.force_std
    report: dict[str, Any] = {"force": "of the source"}
    if std is None:
        length = elongation(series) if np.array_equal(series.record.time, series.time) else None
        known = None if length is None or not np.isfinite(length).all() else length
        found = force_noise(series.record.time, series.record.force, known)
        std, report = found.std, {"force": found.origin, "load_cell_difference_order": found.order}
        report["load_cell_std_at_most_N"] = found.most
    report |= {
        "load_cell_std_N": std,
        "load_cell_readings": len(series.record.time),
        "synchronisation_std_s": series.synchronisation_std,
        "force_rate_N_per_s": slope,
    }
    return (0.0, float(np.hypot(std, slope * series.synchronisation_std))), report
