"""A discovery as the report looks at it: forces read and predicted, residuals over the specimen.

In: a `Discovery`. Out: arrays for figures and files; residuals decorrelated, in units of their standard deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.base_functions import first_guess
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.evidence.explanations import Weighing
from calibrate.diagnosis.misfit import Misfit, misfit
from calibrate.diagnosis.model_weights import noise_of
from calibrate.diagnosis.problem import Part, Problem
from calibrate.diagnosis.replayed.replay_verdict import stiffness_level
from calibrate.diagnosis.selection import Discovery
from calibrate.diagnosis.selection.rounds import Round
from calibrate.effects import Effect
from calibrate.effects.support.stiffness_over_place import stiffness_over_place
from studies.output.findings import Finding

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class View:
    """A discovery, what was held out in words, and remarks on the input. quick: fewer pictures."""

    discovery: Discovery
    hold_out: str
    remarks: tuple[Finding, ...] = ()
    quick: bool = False

    @property
    def weighing(self) -> Weighing | None:
        """Of all explanations, with what the test shows at the level of the final model; None where it was not made."""
        found = self.discovery.weighing
        return found and replace(found, powers=tuple(one.stiffer(self.level) for one in self.discovery.powers))

    @property
    def inclusion(self) -> dict[str, float]:
        """See `Weighing.inclusion`."""
        found = self.discovery.weighing
        return {} if found is None else found.inclusion

    @property
    def unit(self) -> str:
        """MPa, or N/mm where the thickness is unknown."""
        return self.discovery.problem.parts[0].experiment.stress_unit

    @cached_property
    def level(self) -> float:
        """By which the stiffness of the final model is multiplied: what replayed forces or a nominal level ask for, or 1."""
        return stiffness_level(self.discovery, self.discovery.final)

    @cached_property
    def errors(self) -> tuple[tuple[Misfit, Misfit | None], ...]:
        """Errors of the base and of the final model, each at its level, as its file has it: of the equations fitted, and of those held out."""
        found = self.discovery
        first = self._errors(found.start or found.problem, found.rounds[0])
        return first, self._errors(found.problem, found.rounds[-1])

    @cached_property
    def neo_hooke_error(self) -> float:
        """Relative force error of one modulus, the mean of those that fit each test best, on the equations fitted; NaN where no force is among them."""
        problem = self.discovery.problem
        c = first_guess([(part.assembled, part.train.rows) for part in problem.trained])
        found = misfit(problem, c, (), held=False)
        assert found is not None
        return found.force

    def _errors(self, problem: Problem, now: Round) -> tuple[Misfit, Misfit | None]:
        level = stiffness_level(self.discovery, now.fit)
        if level == 1.0:
            return now.train, now.held
        additions = tuple(one.stiffer(level) for one in now.fit.additions)
        fitted, held = (misfit(problem, level * now.fit.c, additions, which) for which in (False, True))
        assert fitted is not None
        return fitted, held

    def forces(self, part: Part, fit: Fit) -> dict[str, tuple[Array, Array, Array]]:
        """As `forces`, at the level of the fit."""
        return forces(part, fit, stiffness_level(self.discovery, fit))

    @property
    def models(self) -> dict[str, Fit]:
        """The base and, where something was added, the final model."""
        first, last = self.discovery.base, self.discovery.final
        return {"base model": first} if last is first else {"base model": first, "final model": last}

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Every effect that was a candidate in a round or is in its model: some are candidates only beside another."""
        rounds = self.discovery.rounds
        candidates = [one.score.effect for now in rounds for one in now.candidates]
        added = [one.effect for now in rounds for one in now.fit.additions]
        return tuple({effect.name: effect for effect in (*candidates, *added)}.values())

    @cached_property
    def maps(self) -> tuple[dict[str, Array], ...]:
        """Of each test, the decorrelated residuals (t, n) of every model at the nodes."""
        problem, models = self.discovery.problem, self.models
        each = [decorrelated(problem, part, list(models.values())) for part in problem.parts]
        return tuple(
            {name: nodal(part, one) for name, one in zip(models, of_part, strict=True)}
            for part, of_part in zip(problem.parts, each, strict=True)
        )


def stiffness_of_triangles(part: Part, fit: Fit) -> Array | None:
    """Stiffness (m,) of the triangles over that of the material, by all effects of the model that vary it over the sheet; None where it has none."""
    acting = [one for one in part.valid(fit.additions) if one.effect.stage == "stiffness"]
    fields = ((one.effect, np.array(one.amplitudes), np.array(one.shape)) for one in acting)
    return np.asarray(stiffness_over_place(part.chain.data, len(part.experiment.triangles), fields)) if acting else None


def residual(part: Part, fit: Fit) -> Array:
    """Residual (t, 2 v), N, of a fit."""
    return part.own_residual(fit.c, part.valid(fit.additions))


def held_increments(part: Part) -> NDArray[np.bool_]:
    """(t,): increments no equation of which was used for fitting."""
    return ~part.fitted_increments


def forces(part: Part, fit: Fit, level: float = 1.0) -> dict[str, tuple[Array, Array, Array]]:
    """Each loaded boundary's force (t, 2), N: measured, as the fit predicts the reading, standard deviation expected. level: by which a
    nominal stiffness is multiplied."""
    system, n = part.system, part.system.fields.n_fields
    r, spread = residual(part, fit), level * deviations(part)
    given = part.chain.given(part.valid(fit.additions))
    result = {}
    for v in np.flatnonzero(system.fields.boundary >= 0):
        recorded = system.recorded[:, [v, n + v]]
        name = part.experiment.loaded[system.fields.boundary[v]].name
        carried = (given + r)[:, [v, n + v]]
        result[name] = (recorded, level * carried, spread[:, [v, n + v]])
    return result


def deviations(part: Part) -> Array:
    """Standard deviation (t, 2 v), N, of every residual by noise and discretisation; NaN where there is no equation."""
    discrepancy = 0.0 if part.common is None else part.common.variances
    known = part.train.rows | part.held.rows
    return np.where(known, np.sqrt(part.train.variance + part.held.variance + discrepancy), np.nan)


def decorrelated(problem: Problem, part: Part, fits: Sequence[Fit]) -> list[Array]:
    """Residuals (t, 2 v) of fits, of unit covariance, that stay as close as can be to the virtual field they are named after.

    With s the standard deviations and R the correlations of an increment, R^-1/2 r / s (Kessy, Lewin and Strimmer 2018).
    """
    noise = noise_of(part, problem.weights_c, problem.amplifying, problem.trained)
    residuals = np.array([residual(part, fit) for fit in fits])
    result = np.full(residuals.shape, np.nan)
    for i, used in [(i, w.rows[i]) for w in (part.train, part.held) for i in range(len(w.rows)) if w.rows[i].any()]:
        covariance = noise.increment(i)[np.ix_(used, used)]
        if part.common is not None:
            sources = part.common.increment(i)[used]
            covariance = covariance + sources @ sources.T
        spread = np.sqrt(np.diag(covariance))
        values, vectors = np.linalg.eigh(covariance / np.outer(spread, spread))
        root = np.sqrt(np.maximum(values, 1e-12 * values.max()))
        result[:, i, used] = ((residuals[:, i, used] / spread) @ vectors / root) @ vectors.T
    return list(result)


def nodal(part: Part, values: Array) -> Array:
    """Root mean square of two components (t, n) at the nodes, of one (t, 2 v) for each virtual field."""
    size = np.sqrt((np.nan_to_num(values).reshape(len(values), 2, -1) ** 2).mean(axis=1))
    hats = part.system.fields.values
    return (hats @ size.T).T / np.maximum(np.asarray(hats.sum(axis=1)).ravel(), 1e-12)
