"""Standard deviation of the stress that a diagnosed model predicts in a homogeneous test.

In: a `DiagnosedLaw` whose file holds its uncertainty, a test. Out: variances by what they are from:

- *parameters* of base and effects, to first order, and the *level* of the stiffness by the forces of the replay, of which the parameters hold a part, too;
- *formula*: effects are wrong by 2 % of what they change;
- *competitors*, averaged by evidence: sum_k p_k d_k^2 with d_k the change to another explanation. Among them are effects that the test does not show, as large as they may be: in
  deformation modes that it does not hold they open the band;
- *extrapolation*: beyond the calibrated range by a share x of the strain, in all or near a mode, or of the time, wrong by x times what the model is wrong by where it was fitted, and at least by x times
  the error of a formula, as in the replay.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.parameters import Variables
from calibrate.effects.chain import Additions
from calibrate.effects.effect import FORMULA_ERROR
from calibrate.models.diagnosed_law import DiagnosedLaw
from calibrate.models.model_uncertainty import ModelUncertainty

Array = NDArray[np.float64]
STEP = 1e-3  # of the size of a parameter, of finite differences


def variances(
    law: DiagnosedLaw, known: ModelUncertainty, mode: str, x: Array, direction: str, stress: Array, beyond: Array
) -> dict[str, Array]:
    """(k,) each, of stresses (k,) in the unit of the model, at stretches (k,) along a direction, by shares (k,) beyond the calibrated strain."""
    model = law.model
    n, variables = len(model.c), Variables(model.additions)

    def with_(c: Array, additions: Additions) -> DiagnosedLaw:
        errors = tuple((0.0,) * len(a.amplitudes) for a in additions)
        return replace(law, model=replace(model, c=c, additions=additions, errors=errors, uncertainty=None))

    sizes = np.concatenate([np.full(n, np.abs(model.c).max()), variables.scale if model.additions else []])
    shares = STEP / np.maximum(np.abs(known.root / sizes[:, None]).max(axis=0), STEP)
    along_root = [
        with_(model.c + step[:n], variables.at(variables.values + step[n:]) if model.additions else ())
        for step in (known.root * shares).T
    ]
    others = [with_(one.c, one.additions) for one in known.competitors]
    changes = law.changes(mode, x, direction, [*along_root, *others, with_(model.c, ())])
    q, odds = len(along_root), np.array([one.probability for one in known.competitors])
    wrong = max(FORMULA_ERROR, known.error) * _beyond(law, known, x, beyond)
    return {
        "parameters": ((changes[:q] / shares[:, None]) ** 2).sum(axis=0),
        "level": (known.level_deviation * stress) ** 2,
        "formula": (FORMULA_ERROR * changes[-1]) ** 2,
        "competitors": (odds[:, None] * changes[q:-1] ** 2).sum(axis=0),
        "extrapolation": (wrong * stress) ** 2,
    }


def _beyond(law: DiagnosedLaw, known: ModelUncertainty, x: Array, strain: Array) -> Array:
    """(k,): share by which strain (k,), or time of a material that relaxes, is beyond what was fitted."""
    if law.duration is None or known.last_time is None or not law.model.relaxes:
        return strain
    time = law.duration * (x - 1) / (x.max() - 1)
    return np.maximum(strain, time / known.last_time - 1)
