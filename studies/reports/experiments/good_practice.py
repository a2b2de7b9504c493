"""What a DIC measurement should state, after the reporting table of Jones and Iadicola, A Good Practices Guide for Digital Image
Correlation (iDICs 2018, section 5.4). In: an Experiment. Out: rows of a table; what no file and nobody stated is 'not stated'.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from calibrate.data.experiment import Experiment

NOT_STATED = "not stated"
STATED = {
    "camera": "camera",
    "lens": "lens",
    "image_resolution": "image resolution",
    "field_of_view": "field of view",
    "image_scale": "image scale",
    "stereo_angle": "stereo angle",
    "frame_rate": "frame rate",
    "patterning": "patterning technique",
    "software": "software",
    "subset": "subset size",
    "step": "step size",
    "matching_criterion": "matching criterion",
    "interpolation": "interpolation",
    "shape_functions": "subset shape function",
    "filter": "filter of the displacements",
    "strain_window": "strain window of the program",
}


def good_practice_rows(experiment: Experiment) -> list[list[Any]]:
    """[quantity, value] of every item."""
    provenance = experiment.provenance
    stated = provenance.get("recording", {})
    rows: list[list[Any]] = [[title, stated.get(key) or NOT_STATED] for key, title in STATED.items()]
    width, height = np.ptp(experiment.points, axis=0)
    rows.append(["region of interest", f"{width:.4g} x {height:.4g} mm, {len(experiment.points)} points"])
    floor = provenance.get("static")
    if floor is None:
        return [*rows, *([name, NOT_STATED] for name in ("noise floor of displacement", "noise floor of strain"))]
    frames = f"{floor['frames']} static frames"
    return [
        *rows,
        ["noise floor of displacement", f"{1e3 * floor['displacement_std']:.2g} um ({frames})"],
        ["of it, fixed from frame to frame", f"{1e3 * floor['fixed_pattern_std']:.2g} um"],
        ["noise floor of strain", f"{100 * floor['strain_std']:.2g} % in a triangle, not smoothed ({frames})"],
    ]
