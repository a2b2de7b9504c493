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
from calibrate.diagnosis import base_functions
from calibrate.diagnosis.effect_fit import Fit, refit
from calibrate.diagnosis.model_weights import weighted_part
from calibrate.diagnosis.problem import Part, Problem, base_columns
from calibrate.effects.chain import Chain
from calibrate.equations.basis import energy_basis
from calibrate.errors import NoTwinError
from calibrate.fitting.least_squares import bounded
from calibrate.models.extended_model import ExtendedModel

Array = NDArray[np.float64]
# the test with displacements and forces of the model; raises `NoTwinError`
Replay = Callable[[Experiment, ExtendedModel], Experiment]


def with_twins(problem: Problem, fit: Fit, replay: Replay) -> tuple[Problem, Fit, tuple[str, ...]]:
    """The problem with a twin of every test that can be replayed with the base of the fit, and the base fitted again; why others have none."""
    parts, reasons, c = [], [], stiffening_base(problem, fit)
    for part in problem.parts:
        model = ExtendedModel(problem.basis, c, (), (), part.experiment.stress_unit)
        try:
            chosen, shares = turning_points(part.experiment.displacements)
            twin = shares @ residual(part, c, replay(part.experiment.select(chosen), model))
        except NoTwinError as error:
            parts.append(part)
            reasons.append(str(error))
        else:
            parts.append(_with_twin(problem, part, np.where(part.system.level_equation, 0.0, twin)))  # nominal as it is
    if all(part.twin is None for part in parts):
        return problem, fit, tuple(reasons)
    problem = replace(problem, parts=tuple(parts))
    return problem, refit(problem, fit.c, ()), tuple(reasons)


def stiffening_base(problem: Problem, fit: Fit) -> Array:
    """Coefficients (n,) of a base that does not soften with I1, nearest to the data of a fit: its energy is convex, so that there is an
    equilibrium. A base that makes up for a missing effect may have none."""
    if problem.parametric:
        return fit.c
    top = max(base_functions.trained_top(part.system, part.train.rows) for part in problem.trained)
    cone = base_functions.base_cone(problem.basis, "convex", top)
    bulk = problem.basis.n_functions - energy_basis(problem.basis).n_functions
    n = cone.shape[1]
    prior = float(np.abs(problem.prior).max()) * base_functions.smoothness("convex", n - bulk, bulk)
    G = base_columns(problem, fit.chains)
    return cone @ bounded(G @ cone, G @ fit.c - fit.residual, np.zeros(n), np.full(n, np.inf), prior)


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
