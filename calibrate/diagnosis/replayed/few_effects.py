"""Few effects that leave least of the fields of a replay, for tests that nothing explains.

The equilibrium gap weighs equations by noise. Where a model is wrong by far more than that it refuses every effect: beside what else is missing, none leaves less. A replay weighs what
a user sees, displacements, and its evidence (`field_evidence`) has a discrepancy as large as what is left. So here all sets of up to three effects beside neo-Hooke are ranked, to first order about the
replay of neo-Hooke; the most probable are fitted to replays (`field_fit`), none beyond its prior, and weighed once more. With displacements prescribed the level of a neo-Hookean sheet changes no
field, and relaxation hardly: forces are left to `updating`, of the best set and of those that compete with it.

In: replays, computed elsewhere. Out: `FewEffects`. Nothing that is held out is used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.evidence.explanations import RIVALS, TIE, Alternatives, Explanation
from calibrate.diagnosis.evidence.linear_evidence import Signature
from calibrate.diagnosis.parameters import Variables
from calibrate.diagnosis.replayed.averaged import Averaged, averaged
from calibrate.diagnosis.replayed.checked_replay import NoReplayCheck, ReplayCheck, Replayed
from calibrate.diagnosis.replayed.field_evidence import FieldEvidence
from calibrate.diagnosis.replayed.field_fit import FieldFit
from calibrate.diagnosis.replayed.observations import ReplayErrors, level_of
from calibrate.diagnosis.replayed.replayed_rows import Replays
from calibrate.diagnosis.replayed.updating import Updated
from calibrate.effects import Effect
from calibrate.effects.chain import Addition, Additions
from calibrate.fitting.resumable import SILENT, Resumable

Array = NDArray[np.float64]
Shape = tuple[float, ...]
Names = tuple[str, ...]  # of the effects of a set, sorted
FITTED, MOST_FITS = 4, 8  # sets, the most probable; until these are fitted, at most
LISTED = 0.01  # probability, from which a set is told


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect to choose from: shapes to try, and prior standard deviations (p,) of its amplitudes."""

    effect: Effect
    shapes: tuple[Shape, ...]
    deviations: Array

    def at_null(self, shape: Shape) -> Addition:
        """With this shape."""
        return Addition(self.effect, tuple(p.null for p in self.effect.amplitudes), shape)

    def signature(self, shape: Shape, columns: Array) -> Signature:
        """columns: derivatives (m, p) of the residual by amplitudes, or with those by shapes about the one that was tried."""
        one_sided = np.array([p.lower == p.null for p in self.effect.amplitudes])
        of_shapes = np.zeros(columns.shape[1] - len(one_sided), bool)
        return Signature(self.effect.name, shape, columns, 1 / len(self.shapes), np.append(one_sided, of_shapes))


@dataclass(frozen=True, eq=False)
class FittedSet:
    """A set after its fit to replays: log_odds against none; errors: of pictures that were fitted; discrepancy: tau, mm, of a smooth mode; priors: mean and standard deviation
    of every amplitude and shape by the fields; at_limit: which amplitudes (p,) the priors stop."""

    additions: Additions
    log_odds: float
    errors: ReplayErrors
    discrepancy: float
    priors: dict[str, tuple[Array, Array]]
    at_limit: dict[str, NDArray[np.bool_]]

    @property
    def effects(self) -> Names:
        return tuple(sorted(a.effect.name for a in self.additions))


@dataclass(frozen=True, eq=False)
class Usable:
    """A model to predict with: base c (n,), MPa, effects that are not at their null values, their deviations, and its replay."""

    c: Array
    additions: Additions
    deviations: tuple[tuple[float, ...], ...]
    replayed: Replayed | NoReplayCheck | None


@dataclass(frozen=True, eq=False)
class FewModel:
    """A set and its probability, with what the forces add to its model; or why they could not."""

    effects: Names
    probability: float
    updated: Updated | NoReplayCheck

    @property
    def check(self) -> ReplayCheck | None:
        """Its replay with its band; None where it has none."""
        return self.updated.check if isinstance(self.updated, Updated) else None

    @property
    def replayed(self) -> Replayed | None:
        """With what was held out; None where it was not replayed."""
        return None if self.check is None else self.check.final

    @property
    def usable(self) -> Usable | None:
        """The model to predict with; None where it was not updated."""
        new = self.updated
        return Usable(new.c, *new.present, self.replayed) if isinstance(new, Updated) else None


@dataclass(frozen=True, eq=False)
class FewEffects:
    """c (n,), MPa: neo-Hooke, at the level of the forces of its replay; base: its errors in pictures that were fitted. alternatives: all sets; fitted: the most probable, after their fits, best first.
    models: the best with its forces and relaxation, then those that compete with it. neo_hooke: its replay, with what was held out."""

    c: Array
    base: ReplayErrors
    alternatives: Alternatives
    fitted: tuple[FittedSet, ...]
    models: tuple[FewModel, ...] = ()
    neo_hooke: Replayed | NoReplayCheck | None = None

    @property
    def sets(self) -> tuple[tuple[Names, float], ...]:
        """Effects and probability of those to tell, best first."""
        return tuple(
            (one.names, one.probability) for one in self.alternatives.explanations if one.probability >= LISTED
        )

    @property
    def inclusion(self) -> dict[str, float]:
        """Probability of every effect that is seen."""
        return self.alternatives.inclusion

    @property
    def best(self) -> FittedSet | None:
        """None where neo-Hooke alone is more probable."""
        return self.fitted[0] if self.fitted and self.fitted[0].log_odds > 0 else None

    @property
    def to_update(self) -> tuple[tuple[Names, float, FittedSet | None], ...]:
        """Effects and probability of the best, and of at most `RIVALS` that compete with it, with their fits; of neo-Hooke alone there is none."""
        known = {one.effects: one for one in self.fitted}
        first = () if self.best is None else self.best.effects
        others = [names for names, p in self.sets if p > TIE and names != first and (not names or names in known)]
        probability = {one.names: one.probability for one in self.alternatives.explanations}
        return tuple((names, probability.get(names, 0.0), known.get(names)) for names in (first, *others[:RIVALS]))

    @property
    def average(self) -> Averaged | None:
        """Of the models that compete, by their probabilities; None where there is one at most."""
        return averaged([(one.probability, one.check) for one in self.models if one.check is not None])

    @property
    def usable_neo_hooke(self) -> Usable:
        """The base alone."""
        return Usable(self.c, (), (), self.neo_hooke)


def few_effects(
    replays: Replays, c: Array, candidates: Sequence[Candidate], say: Resumable = SILENT
) -> FewEffects | None:
    """Beside neo-Hooke, coefficients c (n,). None where it has no equilibrium."""
    first = replays(c, ())
    if first is None:
        return None
    c = c * level_of(first.rows).factor
    replayed = replays(c, ())
    assert replayed is not None  # the level changes no field
    c = c * level_of(replayed.rows).factor  # in weights of the noise that belongs to it
    priors = {one.effect.name: one.deviations for one in candidates}
    base = FieldFit(c, (), (), replayed, priors)
    known = {one.effect.name: one for one in candidates}
    evidence = FieldEvidence.of(
        base.residual, base.modes, [s for one in candidates for s in _signatures(base, one)], len(candidates)
    )
    ranked = evidence.best()
    sets = {tuple(sorted(evidence.names(one))): one.members for one in evidence.by_names(ranked, len(ranked))}
    values = {names: evidence.subset(members).log_evidence for names, members in sets.items()}
    fitted: dict[Names, FittedSet] = {}
    while len(fitted) < MOST_FITS:
        first_of = sorted(values, key=lambda key: -values[key])[:FITTED]
        names = next((key for key in first_of if key and key not in fitted), None)
        if names is None:
            break
        stage = f"replays with {' and '.join(names)}"
        say(stage)
        fitted[names] = say.checkpointed(stage, partial(_fitted, replays, base, evidence, known, sets[names]))
        values[names] = fitted[names].log_odds
    alternatives = Alternatives.of([Explanation(names, value) for names, value in values.items()])
    return FewEffects(c, base.errors, alternatives, tuple(sorted(fitted.values(), key=lambda one: -one.log_odds)))


def _signatures(fit: FieldFit, one: Candidate) -> list[Signature]:
    """Of an effect that is not there: at null a shape changes nothing."""
    return [one.signature(shape, fit.slopes((one.at_null(shape),))[:, : len(one.deviations)]) for shape in one.shapes]


def _fitted(
    replays: Replays, base: FieldFit, evidence: FieldEvidence, known: Mapping[str, Candidate], members: tuple[int, ...]
) -> FittedSet:
    """From null on; shapes are fitted, too."""
    chosen = [evidence.signatures[i] for i in members]
    start = tuple(known[one.name].at_null(one.shape) for one in chosen)
    fit = replace(base, start=start, additions=start).at_minimum(replays, evidence.tau(members))
    parts = np.split(fit.S, np.cumsum(Variables(start).sizes)[:-1], axis=1)
    own = [known[one.name].signature(one.shape, columns) for one, columns in zip(chosen, parts, strict=True)]
    at_end = FieldEvidence.of(fit.at_start, base.modes, own, len(known), evidence.taus)
    everything = tuple(range(len(at_end.signatures)))
    log_odds = at_end.subset(everything).log_evidence + at_end.of_none - evidence.of_none
    tau = at_end.tau(everything)
    return FittedSet(fit.additions, log_odds, fit.errors, tau, fit.posterior(tau), fit.at_limit)
