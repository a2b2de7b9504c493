"""What the diagnosis says of the fibrous data: fibre effects of the catalogue beside the second invariant.

In: an Experiment of the Holzapfel solid. Out: verdict, what was named, its amplitudes and angles, time. The catalogue's fibres have
the exponential of the truth, but also bear compression, and have no dispersion.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from calibrate.data.experiment import Experiment
from calibrate.diagnosis.discovery import discover
from calibrate.effects.fibres import OneFibreFamily, TwoFibreFamilies
from calibrate.effects.second_invariant import SecondInvariant
from calibrate.errors import EquigapError


def search(experiment: Experiment) -> dict[str, Any]:
    """The diagnosis among three effects; a refusal is an answer."""
    start = time.process_time()
    effects = (OneFibreFamily(), TwoFibreFamilies(), SecondInvariant())
    try:
        found = discover([experiment], effects=effects)
    except EquigapError as error:
        return {"refused": str(error), "cpu_seconds": time.process_time() - start}
    additions = [
        {
            "effect": a.effect.name,
            "amplitudes": np.asarray(a.amplitudes).tolist(),
            "shape": np.asarray(a.shape).tolist(),
        }
        for a in found.final.additions
    ]
    return {
        "verdict": str(found.verdict),
        "named": [str(name) for name in found.named],
        "additions": additions,
        "cpu_seconds": time.process_time() - start,
    }
