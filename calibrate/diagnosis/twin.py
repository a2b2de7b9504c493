"""The twin of a test: the same test solved by finite elements, whose residual is discretisation error and nothing else.

In: a `Problem`, its base fit, and a `Replay` that solves a test with a model. Out: the problem with the residual of the twin in its parts, and
weights that allow only for what a twin may miss; the base fitted to it; and why a test has no twin.

The replayed fields are in equilibrium with the replayed forces. Seen by the triangles of the camera, through the chain of the measured ones, they
leave a residual that the measured ones have, too. It depends little on the base and on the noise of the grips that the replay moves by, so that
one replay of the base is enough; but an effect of the material that is as strong as the base changes it, so that a model has its own twin once an effect
was added (docs/discover_method.md, "Weights"). It is smooth in the load, so that not every increment is replayed: between two, the residual is
interpolated as the measured displacements are. What subsets of the correlation make of the field, how steep it is at
free edges, and how a thick sheet bends there, is told by the twin, too, between the camera's points (`twin_kinematics`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.data.load_path import turning_points
from calibrate.diagnosis import base_functions, weighted_fit
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.problem import Part, Problem, base_columns
from calibrate.effects.chain import Additions, Chain
from calibrate.effects.finite_thickness import bend_errors
from calibrate.effects.support.borders import subset_moments
from calibrate.effects.support.effect_data import Data, edge_means
from calibrate.effects.support.finite_element_field import FiniteElementField
from calibrate.effects.support.nodal_derivatives import gradients, second_derivatives
from calibrate.effects.support.twin_kinematics import (
    Bend,
    Subsets,
    TwinKinematics,
    edge_gradients,
    sides_of_subsets,
    subset_readings,
)
from calibrate.equations.basis import energy_basis
from calibrate.equations.discretisation_error import REMAINDER
from calibrate.errors import NoTwinError
from calibrate.fitting.least_squares import bounded
from calibrate.models.extended_model import ExtendedModel

Array = NDArray[np.float64]
LEAST = 0.05  # of the mean stiffness, that a base has at rest where it is replayed


@dataclass(frozen=True, eq=False)
class Replayed:
    """test: with displacements and forces of the model. field: displacements between its points. finer: the test on triangles between more points, the first of which are its
    own. None: they are not known."""

    test: Experiment
    field: FiniteElementField | None = None
    finer: Experiment | None = None


Replay = Callable[[Experiment, ExtendedModel], Replayed]  # raises `NoTwinError`


def with_twins(problem: Problem, fit: Fit, replay: Replay) -> tuple[Problem, Fit, tuple[str, ...]]:
    """The problem with a twin of every test that can be replayed with the base of the fit, and the base fitted again; why others have none."""
    found, reasons = _replayed(replace(problem, replay=replay), stiffening_base(problem, fit), ())
    if all(part.twin is None for part in found.parts):
        return problem, fit, reasons
    return *weighted_fit.refitted(found, fit), reasons


def with_own_twins(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """The same with twins of the effects in the material, too, or without those that the model has lost, and everything fitted again; where that model cannot be replayed, with
    those that it had."""
    additions = tuple(a for a in fit.additions if a.effect.of_material)
    if problem.replay is None or not (additions or problem.twin_has_effects):
        return problem, fit
    c = fit.c if additions else stiffening_base(problem, fit)
    return weighted_fit.refitted(_replayed(problem, c, additions)[0], fit)


def _replayed(problem: Problem, c: Array, additions: Additions) -> tuple[Problem, tuple[str, ...]]:
    """With twins of the base c (n,) and effects of the material, for tests that can be replayed; why others cannot."""
    assert problem.replay is not None
    parts, reasons = [], []
    for part in problem.parts:
        try:
            twin, kinematics = _twin(part, c, additions, problem.replay)
            part = replace(part, twin=twin, chain=part.chain.with_twin(kinematics))
        except NoTwinError as error:
            reasons.append(str(error))
        parts.append(part)
    return replace(problem, parts=tuple(parts), twin_has_effects=bool(additions)), tuple(reasons)


def stiffening_base(problem: Problem, fit: Fit) -> Array:
    """Coefficients (n,) of a base that does not soften with I1 and is not without stiffness at rest, nearest to the data of a fit: its energy is convex, so that
    there is an equilibrium. A base that makes up for a missing effect may have none."""
    bulk = problem.basis.n_functions - energy_basis(problem.basis).n_functions
    if problem.cone.shape[1] == 1 + bulk:
        return fit.c
    top = max(base_functions.trained_top(part.system, part.train.rows) for part in problem.trained)
    cone = base_functions.base_cone(problem.basis, "convex", top)
    n = cone.shape[1]
    G = base_columns(problem, fit.chains)
    least = np.zeros(n)
    least[0] = LEAST * max(float(fit.c[: len(fit.c) - bulk].mean()), 0.0)  # the first column is constant in I1
    return cone @ bounded(G @ cone, G @ fit.c - fit.residual, least, np.full(n, np.inf))


def residual(part: Part, c: Array, replayed: Experiment, additions: Additions = ()) -> Array:
    """Residual (t, 2 v), N, of a replay with the base c (n,) and effects of the material, as the equations of a part see it."""
    system = replace(part.system, experiment=replayed)
    chain = Chain(system, part.chain.basis)
    return chain.work(chain.stress(c, additions)) - np.nan_to_num(system.recorded)


def _twin(part: Part, c: Array, additions: Additions, replay: Replay) -> tuple[Array, TwinKinematics | None]:
    """Residual (t, 2 v), N, of all increments, of the equation of a nominal level none; and what it knows of the kinematics. A history is replayed whole. Raises `NoTwinError`."""
    experiment = part.experiment
    chosen, shares = turning_points(experiment.displacements)
    if any(a.effect.remembers for a in additions):
        chosen, shares = np.arange(experiment.n_increments), np.eye(experiment.n_increments)
    deviations = tuple((0.0,) * len(a.amplitudes) for a in additions)
    model = ExtendedModel(part.chain.basis, c, additions, deviations, experiment.stress_unit)
    replayed = replay(experiment.select(chosen), model)
    found = np.where(part.system.level_equation, 0.0, shares @ residual(part, c, replayed.test, additions))
    if replayed.field is None:
        return found, None
    kinematics = _kinematics(part.chain.data, replayed.field.interpolated(shares))
    if replayed.finer is None or experiment.thickness is None:
        return found, kinematics
    missed = bend_errors(replayed.test, replayed.finer)
    return found, replace(kinematics, bend=Bend(*(jnp.asarray(np.tensordot(shares, one, 1)) for one in missed)))


def _kinematics(data: Data, field: FiniteElementField) -> TwinKinematics:
    """Without the bend, of a replay of all increments, as uncertain as its residual: by a share of what the camera's triangles alone would miss."""
    points, distances = np.asarray(data.points), np.asarray(data.lines[:, 0, 0])
    u = jnp.asarray(field.displacements[:, : len(points)])
    sides, second = sides_of_subsets(float(np.sqrt(2.0 * np.median(data.areas)))), second_derivatives(data, u)
    readings = jnp.stack([jnp.asarray(subset_readings(field, points, distances, side)) for side in sides])
    seen = [0.5 * jnp.einsum("nij,tncij->tnc", subset_moments(data.lines, side), second) for side in sides]
    beside = data.beside_edges
    exact = edge_gradients(field, points, np.asarray(data.centroids)[beside], np.asarray(data.edge_nodes)[beside])
    of_camera = jnp.stack([gradients(data, u), jnp.eye(2) + edge_means(data, u)])
    missed = exact - of_camera[:, :, beside]
    return TwinKinematics(
        Subsets(jnp.asarray(sides), readings, REMAINDER * (readings - jnp.stack(seen))), missed, REMAINDER
    )
