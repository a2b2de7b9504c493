"""What a sheet's record says before any model: forces, gaps, contraction and the pattern that does not grow with the load.

In: a published sheet. Out: `RecordResult`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.equations import recovery
from studies.sheets.measured_results import RecordResult

Array = NDArray[np.float64]
SHEETS = ("Soft_Homo", "Stiff2_Homo", "Stiff2_Hetero")
MANY = 40  # increments from which the record is described
EARLY = (1.0, 12.0)  # s: strain is fitted with a parabola in the elongation
BANDS = 12


def record(name: str, e: Experiment, many: Experiment) -> RecordResult:
    """Forces, missing frames, exponent of the force, ratio of contraction, and strain profiles of a sheet.

    e: with the increments that are fitted; many: the same sheet with `MANY` increments.
    """
    assert many.time is not None
    pull = np.abs(many.loaded[-1].force[:, 1])
    long = many.displacements[:, many.loaded[-1].nodes, 1].mean(axis=1)
    long = long - many.displacements[:, many.loaded[0].nodes, 1].mean(axis=1)
    gradient = recovery.centroid_gradients(many.points, many.triangles)
    centre = many.points[many.triangles].mean(axis=1)
    axial = (gradient @ many.displacements[..., 1].T)[1::2]
    lateral = (gradient @ many.displacements[..., 0].T)[0::2]
    low, high = many.points.min(axis=0), many.points.max(axis=0)
    band = np.minimum((BANDS * (centre[:, 1] - low[1]) / (high[1] - low[1])).astype(int), BANDS - 1)
    profiles = [np.stack([part[band == b].mean(axis=0) for b in range(BANDS)], axis=1) for part in (axial, lateral)]
    inner = np.abs(centre - 0.5 * (low + high)) < 0.2 * (high - low)
    middle = inner.all(axis=1)
    half = len(long) // 2
    slope = np.polyfit(np.log(long[2:half]), np.log(pull[2:half]), 1)[0]
    return RecordResult(
        name=name,
        time=many.time.tolist(),
        force=pull.tolist(),
        elongation=long.tolist(),
        force_exponent=float(slope),
        contraction=float(-np.log1p(lateral[middle, -1].mean()) / np.log1p(axial[middle, -1].mean())),
        bands_mm=(low[1] + (np.arange(BANDS) + 0.5) * (high[1] - low[1]) / BANDS).tolist(),
        axial=profiles[0].tolist(),
        lateral=profiles[1].tolist(),
        at_rest=[_intercept(many.time, long, part).tolist() for part in profiles],
        missing_frames=e.provenance.get("missing_frames", {}),
        noise=e.provenance["noise"],
        notes=e.provenance["notes"],
    )


def _intercept(time: Array, elongation: Array, strain: Array) -> Array:
    """Strain (bands,) that is left when the elongation goes to zero, from a parabola through the early increments."""
    early = (time > EARLY[0]) & (time < EARLY[1])
    powers = elongation[early, None] ** np.arange(3)
    return np.linalg.lstsq(powers, strain[early], rcond=None)[0][0]
