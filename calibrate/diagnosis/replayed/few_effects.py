"""Few effects that leave least of the fields of a replay, for tests that nothing explains.

The equilibrium gap weighs equations by noise. Where a model is wrong by far more than that it refuses every effect: beside what else is missing, none leaves less. A replay weighs what
a user sees, displacements, and its evidence (`field_evidence`) has a discrepancy as large as what is left. So here all sets of up to three effects beside neo-Hooke are ranked, to first order about the
replay of neo-Hooke; the most probable are fitted to replays (`field_fit`), none beyond its prior, and weighed once more. With displacements prescribed the level of a neo-Hookean sheet changes no
field, and relaxation hardly: forces are left to `updating`.

In: replays, computed elsewhere. Out: `FewEffects`. Nothing that is held out is used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.joint.shares import Usable
from calibrate.diagnosis.parameters import Variables
from calibrate.diagnosis.replayed.checked_replay import NoReplayCheck, Replayed
from calibrate.diagnosis.replayed.field_evidence import FieldEvidence, FieldSignature, RankedSet, Shape
from calibrate.diagnosis.replayed.field_fit import FieldFit
from calibrate.diagnosis.replayed.observations import ReplayErrors, level_of
from calibrate.diagnosis.replayed.updating import Replays, Updated
from calibrate.effects import Effect
from calibrate.effects.chain import Addition, Additions

Array = NDArray[np.float64]
Say = Callable[[str], None]
Names = tuple[str, ...]  # of the effects of a set, sorted
FITTED, MOST_FITS = 4, 8  # sets, the most probable; until these are fitted, at most
LISTED = 0.01  # probability, from which a set is kept


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect to choose from: shapes to try, and prior standard deviations (p,) of its amplitudes."""

    effect: Effect
    shapes: tuple[Shape, ...]
    deviations: Array

    def at_null(self, shape: Shape) -> Addition:
        """With this shape."""
        return Addition(self.effect, tuple(p.null for p in self.effect.amplitudes), shape)

    def signature(self, shape: Shape, columns: Array) -> FieldSignature:
        """columns: derivatives (m, p) of the residual by amplitudes, or with those by shapes about the one that was tried."""
        one_sided = np.array([p.lower == p.null for p in self.effect.amplitudes])
        of_shapes = np.zeros(columns.shape[1] - len(one_sided), bool)
        return FieldSignature(self.effect.name, shape, -columns, len(self.shapes), np.append(one_sided, of_shapes))


@dataclass(frozen=True, eq=False)
class FittedSet:
    """A set after its fit to replays: log_odds against none; errors: of pictures that were fitted; discrepancy: tau, mm, of a smooth mode; priors: mean and standard deviation
    of every amplitude by the fields."""

    additions: Additions
    log_odds: float
    errors: ReplayErrors
    discrepancy: float
    priors: dict[str, tuple[Array, Array]]

    @property
    def effects(self) -> Names:
        return tuple(sorted(a.effect.name for a in self.additions))


@dataclass(frozen=True, eq=False)
class FewEffects:
    """c (n,), MPa: neo-Hooke, at the level of the forces of its replay; base: its errors in pictures that were fitted. sets: all that are probable, best first, (effects, probability).
    fitted: the most probable, after their fits, best first; none where no effect is better. inclusion: probability of every effect. updated: the best with its forces, and relaxation."""

    c: Array
    base: ReplayErrors
    sets: tuple[tuple[Names, float], ...]
    fitted: tuple[FittedSet, ...]
    inclusion: dict[str, float]
    updated: Updated | NoReplayCheck | None = None

    @property
    def best(self) -> FittedSet | None:
        """None where neo-Hooke alone is more probable."""
        return self.fitted[0] if self.fitted and self.fitted[0].log_odds > 0 else None

    @property
    def usable(self) -> Usable | None:
        """The model to predict with; None where it was not updated."""
        new = self.updated
        return Usable(new.c, *new.present, new.replayed) if isinstance(new, Updated) else None

    @property
    def replayed(self) -> Replayed | NoReplayCheck | None:
        """Of the best, with what was held out."""
        return self.updated.replayed if isinstance(self.updated, Updated) else self.updated


def few_effects(
    replays: Replays, c: Array, candidates: Sequence[Candidate], say: Say = lambda text: None
) -> FewEffects | None:
    """Beside neo-Hooke, coefficients c (n,). None where it has no equilibrium."""
    first = replays(c, ())
    if first is None:
        return None
    c = c * level_of(first.rows).factor
    replayed = replays(c, ())
    assert replayed is not None  # the level changes no field
    priors = {one.effect.name: one.deviations for one in candidates}
    base = FieldFit(c, (), (), replayed, priors)
    evidence = FieldEvidence(base.residual, base.modes, len(candidates))
    ranked = evidence.ranked([s for one in candidates for s in _signatures(base, one)])
    known = {one.effect.name: one for one in candidates}
    values, by_names = {one.effects: one.log_odds for one in ranked}, {one.effects: one for one in ranked}
    fitted: dict[Names, FittedSet] = {}
    while len(fitted) < MOST_FITS:
        names = next((key for key in _in_order(values)[:FITTED] if key and key not in fitted), None)
        if names is None:
            break
        say(f"replays with {' and '.join(names)}")
        fitted[names] = _fitted(replays, base, evidence, [known[name] for name in names], by_names[names])
        values[names] = fitted[names].log_odds
    sets, inclusion = _probabilities(values, tuple(known))
    return FewEffects(c, base.errors, sets, tuple(sorted(fitted.values(), key=lambda one: -one.log_odds)), inclusion)


def _in_order(values: dict[Names, float]) -> list[Names]:
    """Most probable first."""
    return sorted(values, key=lambda key: -values[key])


def _signatures(fit: FieldFit, one: Candidate) -> list[FieldSignature]:
    """Of an effect that is not there: at null a shape changes nothing."""
    return [one.signature(shape, fit.slopes((one.at_null(shape),))[:, : len(one.deviations)]) for shape in one.shapes]


def _fitted(
    replays: Replays, base: FieldFit, evidence: FieldEvidence, candidates: Sequence[Candidate], ranked: RankedSet
) -> FittedSet:
    """From null on; shapes are fitted, too."""
    start = tuple(one.at_null(shape) for one, shape in zip(candidates, ranked.shapes, strict=True))
    at_null = [
        s for one, a in zip(candidates, start, strict=True) for s in _signatures(base, replace(one, shapes=(a.shape,)))
    ]
    fit = replace(base, start=start, additions=start).at_minimum(replays, evidence.log_odds(at_null)[1])
    ends = np.cumsum(Variables(start).sizes)[:-1]
    parts = zip(candidates, start, np.split(fit.S, ends, axis=1), strict=True)
    log_odds, tau = evidence.log_odds([one.signature(a.shape, own) for one, a, own in parts], fit.at_start)
    return FittedSet(fit.additions, log_odds, fit.errors, tau, fit.posterior(tau))


def _probabilities(
    values: dict[Names, float], effects: Sequence[str]
) -> tuple[tuple[tuple[Names, float], ...], dict[str, float]]:
    """Of sets, best first, and of effects."""
    names = _in_order(values)
    shares = np.exp(np.array([values[key] for key in names]) - max(values.values()))
    shares /= shares.sum()
    inclusion = {e: float(sum(p for key, p in zip(names, shares, strict=True) if e in key)) for e in effects}
    listed = tuple((key, float(p)) for key, p in zip(names, shares, strict=True) if p >= LISTED)
    return listed, inclusion
