"""The twin of a test: the same test solved by finite elements, whose residual is discretisation error and nothing else.

In: a `Problem`, its base fit, and a `Replay` that solves a test with a model. Out: the problem with the residual of the twin in its parts, and
weights that allow only for what a twin may miss; the base fitted to it; and why a test has no twin.

The replayed fields are in equilibrium with the replayed forces. Seen by the triangles of the camera, through the chain of the measured ones, they
leave a residual that the measured ones have, too. One replay of the base is enough, as the error is of second order: it depends little on
the law and on the noise of the grips that the replay moves by (docs/discover_method.md, "Weights"). It is smooth in the load, so that not every
increment is replayed: between two, the residual is interpolated as the measured displacements are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.data.load_path import turning_points
from calibrate.diagnosis.effect_fit import Fit, refit
from calibrate.diagnosis.model_weights import weighted_part
from calibrate.diagnosis.problem import Part, Problem
from calibrate.effects.chain import Chain
from calibrate.errors import NoTwinError
from calibrate.models.extended_model import ExtendedModel

Array = NDArray[np.float64]
# the test with displacements and forces of the model; raises `NoTwinError`
Replay = Callable[[Experiment, ExtendedModel], Experiment]


def with_twins(problem: Problem, fit: Fit, replay: Replay) -> tuple[Problem, Fit, tuple[str, ...]]:
    """The problem with a twin of every test that can be replayed with the base of the fit, and the base fitted again; why others have none."""
    parts, reasons = [], []
    for part in problem.parts:
        model = ExtendedModel(problem.basis, fit.c, (), (), part.experiment.stress_unit)
        try:
            chosen, shares = turning_points(part.experiment.displacements)
            twin = shares @ residual(part, fit.c, replay(part.experiment.select(chosen), model))
        except NoTwinError as error:
            parts.append(part)
            reasons.append(str(error))
        else:
            parts.append(_with_twin(problem, part, twin))
    if all(part.twin is None for part in parts):
        return problem, fit, tuple(reasons)
    problem = replace(problem, parts=tuple(parts))
    return problem, refit(problem, fit.c, ()), tuple(reasons)


def residual(part: Part, c: Array, replayed: Experiment) -> Array:
    """Residual (t, 2 v), N, of a replay with the base c (n,), as the equations of a part see it."""
    system = replace(part.system, experiment=replayed)
    chain = Chain(system, part.chain.basis)
    return chain.work(chain.stress(c)) - np.nan_to_num(system.recorded)


def _with_twin(problem: Problem, part: Part, twin: Array) -> Part:
    return weighted_part(
        part.chain,
        part.assembled,
        problem.basis,
        problem.c,
        part.train.rows,
        part.held.rows,
        problem.with_discrepancy,
        twin=twin,
    )
