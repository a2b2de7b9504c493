"""How a specimen is loaded: a solved pull in, the Experiment that a camera would record of it out, without noise.

The states of an elastic sheet follow its elongation alone, so that holding and unloading need no other solution.
"""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum

import numpy as np

from calibrate.data.experiment import Experiment
from studies.design.design_plan import AXES, Plan
from studies.design.expected_information import clean_experiment
from studies.design.pulls_within_limits import Pull


class Programme(StrEnum):
    """Over time: to the limit; held there as long again; back to the start at the same speed."""

    RAMP = "ramp"
    HOLD = "ramp and hold"
    BACK = "ramp and back"


def recorded(pull: Pull, plan: Plan) -> Experiment:
    """A whole specimen on its ramp, whose load cells measure along the pull alone. Raises `MeshError`."""
    e = clean_experiment(pull.quarter.mirrored(), pull.specimen, pull.view, plan)
    along = {b.name: np.arange(2) == AXES[b.name] for b in e.loaded}
    return replace(e, loaded=tuple(replace(b, force=np.where(along[b.name], b.force, np.nan)) for b in e.loaded))


def loaded(ramp: Experiment, programme: Programme, duration: float) -> Experiment:
    """A recorded ramp of `duration`, s, under a programme."""
    up = np.arange(ramp.n_increments)
    after = {
        Programme.RAMP: up[:0],
        Programme.HOLD: np.full(len(up) // 2, up[-1]),
        Programme.BACK: up[-2::-1],
    }[programme]
    pause = duration / max(len(after), 1) if programme is Programme.HOLD else duration / len(up)
    time = np.concatenate([(up + 1) * duration / len(up), duration + pause * (np.arange(len(after)) + 1)])
    states = replace(ramp, time=None).select(np.concatenate([up, after]), f"{ramp.name}, {programme}")
    return replace(states, time=time)
