"""Replays of the base and the final model of a diagnosis, which its verdict rests on (`calibrate.diagnosis.replayed`).

In: a `Discovery`. Out: `ReplayCheck`, or why it was not made. With the final model the replay is linearised, which tells what noise and parameters do to it; the most probable
other explanations are replayed, too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.evidence.own_effects import apart, of_own_level
from calibrate.diagnosis.evidence.priors import Priors
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.replayed import replay_rule
from calibrate.diagnosis.replayed.band import Alternative, band_of, level_deviation
from calibrate.diagnosis.replayed.checked_replay import NoReplayCheck, ReplayCheck, Replayed
from calibrate.diagnosis.replayed.few_effects import FewEffects, FewModel, FittedSet
from calibrate.diagnosis.replayed.observations import Observations, level_of
from calibrate.diagnosis.replayed.parameter_spread import Spread, spread_of
from calibrate.diagnosis.replayed.updating import Updated
from calibrate.diagnosis.selection.rounds import Discovery
from calibrate.diagnosis.twin import stiffening_base
from calibrate.effects import Effect
from calibrate.equations.basis import polyconvex
from calibrate.errors import EquigapError
from calibrate.fitting.resumable import SILENT, Resumable
from forward.errors import ForwardError
from meshes.errors import MeshError
from studies.errors import StudyError
from studies.replay.compared_test import ComparedTest, ReplayedModel
from studies.replay.competing_models import own_probability, rivals
from studies.replay.few_effects_replay import FewEffectsReplays
from studies.replay.flat_rows import judging, observations
from studies.replay.law_changes import LawChanges
from studies.replay.parameter_changes import of_parameters
from studies.replay.replay_rows import SheetRows

Array = NDArray[np.float64]
FAILURES = (ForwardError, MeshError, StudyError, EquigapError)
LEAST_INCREMENTS = 2  # of all tests
HIGH = 0.99  # quantile of I1 over the triangles: corners of the grips do not count


class FiniteElementCheck:
    """Replays by `studies.replay`, see `calibrate.diagnosis.replayed.replay_verdict.Check`; what cannot be solved is said, and raises nothing."""

    def __call__(self, found: Discovery) -> ReplayCheck | NoReplayCheck:
        """Base and final model replayed, with level, band and judgement."""
        try:
            return _Check(found).result()
        except FAILURES as error:
            return NoReplayCheck(str(error))

    def few_effects(
        self, found: Discovery, c: Array, effects: Sequence[Effect], priors: Priors, say: Resumable = SILENT
    ) -> FewEffects | NoReplayCheck:
        """Beside neo-Hooke, those that leave least of the fields, with the forces of their replays; of tests that have nothing for themselves, if there are."""
        others = tuple(part for part in found.problem.parts if part.experiment.name not in apart(found.own))
        alike = replace(found.problem, parts=others)
        problem, levels = alike if alike.trained else found.problem, of_own_level(found.own)
        replays = FewEffectsReplays(problem, c, effects, priors, levels, say)
        try:
            few = replays.by_fields()
        except FAILURES as error:
            return NoReplayCheck(str(error))
        models = []
        for names, probability, one in few.to_update:
            stage = f"forces of replays of neo-Hooke{' with ' * bool(names)}{' and '.join(names)}"
            new = say.checkpointed(stage, partial(self._updated, replays, few, one))
            models.append(FewModel(names, probability, new))
        return replace(few, models=_Check(found).of_few(models), neo_hooke=self._at_own_level(found, few.c))

    def _updated(self, replays: FewEffectsReplays, few: FewEffects, one: FittedSet | None) -> Updated | NoReplayCheck:
        try:
            return replays.with_forces(few, one)
        except FAILURES as error:
            return NoReplayCheck(str(error))

    def _at_own_level(self, found: Discovery, c: Array) -> Replayed | NoReplayCheck:
        """A base alone, on the rows that base and final model are compared on."""
        try:
            return _Check(found).at_own_level(ReplayedModel(c, ()))
        except FAILURES as error:
            return NoReplayCheck(str(error))


@dataclass(frozen=True, eq=False)
class _FewReplay:
    """A model of few effects with its replays of every test, and their rows at its level; nothing of one that has none."""

    model: FewModel
    pairs: Sequence[tuple[SheetRows, LawChanges]] = ()
    rows: Observations | None = None


@dataclass(eq=False)
class _Check:
    """The replays of a diagnosis."""

    found: Discovery
    convex: list[Fit] = field(default_factory=list, init=False)

    @cached_property
    def tests(self) -> list[ComparedTest]:
        return [ComparedTest(part) for part in self.found.problem.parts]

    def result(self) -> ReplayCheck:
        """Raises what the replay of the final model raises, `StudyError` where its level leaves no force to judge."""
        if sum(part.experiment.n_increments for part in self.found.problem.parts) < LEAST_INCREMENTS:
            raise StudyError(
                "with one increment its level is fitted to the only force, so that nothing is left to judge"
            )
        final = self.found.final
        pairs = self._with_equilibrium(self.found.problem, final, self._linearised)
        raw = self._rows([rows for rows, _ in pairs])
        base = self._base(raw)
        alternatives, without = self._alternatives(raw)
        found = self._judged(pairs, spread_of(self.found.problem, final), base, alternatives)
        base_fit, final_fit = (any(one is fit for one in self.convex) for fit in (self.found.base, final))
        return replace(found, without=without, stand_ins=(base_fit, final_fit))

    def of_few(self, models: Sequence[FewModel]) -> tuple[FewModel, ...]:
        """Each with its replay beside the base of the diagnosis, where that was replayed, and the others in its band. One that has no replay says why."""
        known = self.found.replay_check
        base = known.base if isinstance(known, ReplayCheck) else None
        replays = [self._replayed(one) for one in models]
        whole = sum(one.model.probability for one in replays if one.rows is not None)
        result = []
        for one in replays:
            others = [
                Alternative(other.model.effects, other.model.probability / whole, other.rows)
                for other in replays
                if other is not one and other.rows is not None
            ]
            result.append(self._with_band(one, base, others))
        return tuple(result)

    def _replayed(self, model: FewModel) -> _FewReplay:
        new = model.updated
        if not isinstance(new, Updated):
            return _FewReplay(model)
        try:
            pairs = self._linearised(ReplayedModel(new.c, new.present[0]))
            raw = self._rows([rows for rows, _ in pairs])
            return _FewReplay(model, pairs, raw.scaled(level_of(raw).factor))
        except FAILURES as error:
            return _FewReplay(replace(model, updated=NoReplayCheck(str(error))))

    def _with_band(self, one: _FewReplay, base: Replayed | None, others: Sequence[Alternative]) -> FewModel:
        new = one.model.updated
        if not isinstance(new, Updated):
            return one.model
        try:
            return replace(one.model, updated=replace(new, check=self._judged(one.pairs, new.spread, base, others)))
        except FAILURES as error:
            return replace(one.model, updated=NoReplayCheck(str(error)))

    def _judged(
        self,
        pairs: Sequence[tuple[SheetRows, LawChanges]],
        spread: Spread,
        base: Replayed | None,
        alternatives: Sequence[Alternative] = (),
    ) -> ReplayCheck:
        """A model at its own level, with its band. base: to be compared with, None where it is the model itself."""
        raw = self._rows([rows for rows, _ in pairs])
        level = level_of(raw)
        rows = raw.scaled(level.factor)
        base_rows = rows if base is None else base.rows
        changes = self._changes(spread, [one for _, one in pairs], level.factor)
        band = band_of(rows, base_rows, level, changes, alternatives, self._beyond(rows))
        own = Replayed(level, level_deviation(level, rows, base_rows, changes), rows)
        judgement = replay_rule.judge(base_rows, rows, band.covariance, self.found.problem.noise_is_known)
        return ReplayCheck(base or own, own, band, judgement, tuple(one.names for one in alternatives))

    def _rows(self, found: Sequence[SheetRows]) -> Observations:
        """Of all tests, with those that may judge."""
        rows = observations(self.tests, found)
        return replace(rows, judges=self._judges(rows))

    def _judges(self, rows: Observations) -> NDArray[np.bool_]:
        """Rows (N,) of tests that have nothing beside a joint model that its replay lacks: of a level the forces alone."""
        return judging(rows, self.tests, apart(self.found.own), of_own_level(self.found.own))

    def at_own_level(self, model: ReplayedModel) -> Replayed:
        """Raises what the replay raises."""
        rows = self._rows([rows for rows, _ in self._linearised(model)])
        level = level_of(rows)
        return Replayed(level, level.deviation, rows.scaled(level.factor))

    def _base(self, raw: Observations) -> Replayed | None:
        """The base at its own level; None where it is the final model."""
        found = self.found
        if found.final is found.base:
            return None
        assert found.start is not None
        rows = self._with_equilibrium(found.start, found.base, lambda model: self._at(model, raw))
        level = level_of(rows)
        return Replayed(level, level.deviation, rows.scaled(level.factor))

    def _with_equilibrium[T](self, problem: Problem, fit: Fit, replays: Callable[[ReplayedModel], T]) -> T:
        """Replays of a fit; where there is no equilibrium, of the nearest base that does not soften with I1, as of a twin."""
        try:
            return replays(ReplayedModel(fit.c, fit.additions))
        except ForwardError:
            self.convex.append(fit)
            return replays(ReplayedModel(stiffening_base(problem, fit), fit.additions))

    def _linearised(self, model: ReplayedModel) -> list[tuple[SheetRows, LawChanges]]:
        return [test.replayed(model, True) for test in self.tests]

    def _at(self, model: ReplayedModel, like: Observations) -> Observations:
        """Rows of another model, with the noise of the final one."""
        return replace(self._rows([test.replayed(model, False)[0] for test in self.tests]), noise=like.noise)

    def _alternatives(self, raw: Observations) -> tuple[tuple[Alternative, ...], tuple[str, ...]]:
        """The most probable other explanations at their own levels, and why others are not among them."""
        made, without, final = [], [], raw.scaled(level_of(raw).factor)
        for names, probability, model in rivals(self.found):
            try:
                rows = self._at(model, raw)
            except FAILURES as error:
                without.append(str(error))
                continue
            rows = rows.scaled(level_of(rows).factor)
            if replay_rule.is_rival(rows, final):
                made.append((names, probability, rows))
            else:
                without.append(
                    f"the replay of {' and '.join(names) or 'the base alone'} misses what was fitted far more than that of the final model"
                )
        whole = own_probability(self.found) + sum(probability for _, probability, _ in made)
        return tuple(Alternative(names, p / whole, rows) for names, p, rows in made), tuple(without)

    def _changes(self, spread: Spread, changes: Sequence[LawChanges], level: float) -> Array:
        """(N, q): change of measured minus replayed along a root of the covariance of the parameters."""
        if not len(spread.root):
            return np.zeros((sum(one.rows.measured.size for one in changes), 0))
        used, pairs = spread.root.any(axis=1), zip(self.tests, changes, strict=True)
        return np.concatenate([of_parameters(*pair, spread.directions, level, used) @ spread.root for pair in pairs])

    def _beyond(self, rows: Observations) -> Array:
        """(N,): share by which strain or time of a row is beyond what was fitted."""
        strains = [np.quantile(polyconvex(t.part.system.isochoric_gradients)[0][..., 0], HIGH, axis=1)[t.part.experiment.pictures]
                   for t in self.tests]  # fmt: skip
        fitted = [~test.held for test in self.tests]
        most = max(float(s[f].max(initial=0.0)) for s, f in zip(strains, fitted, strict=True))
        shares = [np.sqrt(np.maximum(s, 0.0) / most) - 1 for s in strains]
        times = [test.experiment.time for test in self.tests]
        if all(time is not None for time in times):
            last = max(
                float(time[f].max(initial=0.0)) for time, f in zip(times, fitted, strict=True) if time is not None
            )
            shares = [np.maximum(s, time / last - 1) for s, time in zip(shares, times, strict=True) if time is not None]
        found = np.array([shares[i][k] for i, k in zip(rows.test, rows.increment, strict=True)])
        return np.where(rows.held, np.maximum(found, 0.0), 0.0)
