"""What a fit of all effects at once says of each, and how it predicts. Plain data, computed in `everything`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.evidence.priors import FAR
from calibrate.diagnosis.joint.fit import Joint
from calibrate.diagnosis.misfit import Misfit
from calibrate.diagnosis.replayed.checked_replay import NoReplayCheck, Replayed
from calibrate.diagnosis.replayed.updating import Updated
from calibrate.effects import Effect
from calibrate.effects.chain import Additions

Array = NDArray[np.float64]
AT_LIMIT = 0.01  # relative distance from that


@dataclass(frozen=True)
class Share:
    """An effect in the fit of all. amplitudes, deviations, priors (p,): values, standard deviations after and before the test, in the units of the
    effect. rise: of the misfit without it, in dispersions, to first order; r_squared: of its change on those of the base and of the others."""

    effect: Effect
    amplitudes: tuple[float, ...]
    deviations: tuple[float, ...]
    priors: tuple[float, ...]
    shape: tuple[float, ...]
    rise: float
    r_squared: float

    @property
    def largest(self) -> int:
        """Which amplitude is most of its prior standard deviations from null."""
        null = np.array([p.null for p in self.effect.amplitudes])
        return int(np.argmax(np.abs(np.array(self.amplitudes) - null) / np.array(self.priors)))

    @property
    def over_prior(self) -> float:
        """Its distance from null, in prior standard deviations."""
        i = self.largest
        return abs(self.amplitudes[i] - self.effect.amplitudes[i].null) / self.priors[i]

    @property
    def is_seen(self) -> bool:
        """Whether its misfit would rise by more than its penalty is for one of ten thousand equations."""
        return self.rise > len(self.amplitudes) * np.log(1e4)

    @property
    def is_far(self) -> bool:
        """Whether it is stronger than anyone would believe: it stands in for something else."""
        return self.over_prior > (1 + AT_LIMIT) * FAR

    @property
    def is_at_limit(self) -> bool:
        """Whether it is as strong as a fit of plausible effects lets it be: it stands in for something else, too."""
        return not self.is_far and self.over_prior > (1 - AT_LIMIT) * FAR


@dataclass(frozen=True, eq=False)
class Usable:
    """A model to predict with: base c (n,), MPa, effects that are not at their null values, their deviations, and its replay."""

    c: Array
    additions: Additions
    deviations: tuple[tuple[float, ...], ...]
    replayed: Replayed | NoReplayCheck | None


@dataclass(frozen=True, eq=False)
class Everything:
    """The fit of all effects. shares: the most needed first; before, after: errors of the neo-Hookean base and of the fit, on what was fitted and
    on what was held out (None: nothing was). variance: of the discrepancy, over that of the rest, whose dispersion is 1 where it is as
    large as the weights have it: that of noise, in equations without a load times field_variance.
    plausible: with no amplitude beyond its prior, None where none is. replayed: this model by finite elements; updated: by the forces of replays; None: not asked for.
    neo_hooke (n,), MPa: coefficients of the base alone; neo_hooke_replayed: its replay, which every other has to be better than."""

    fit: Joint
    shares: tuple[Share, ...]
    before: tuple[Misfit, Misfit | None]
    after: tuple[Misfit, Misfit | None]
    variance: float
    dispersion: float
    plausible: Everything | None = None
    replayed: Replayed | NoReplayCheck | None = None
    updated: Updated | NoReplayCheck | None = None
    neo_hooke: Array | None = None
    neo_hooke_replayed: Replayed | NoReplayCheck | None = None
    field_variance: float = 1.0

    @property
    def update_in_use(self) -> Updated | None:
        """The updated model where it takes the place of this one: it meets the forces that were fitted better, and was replayed."""
        new = self.updated
        if not isinstance(new, Updated) or new.replayed is None:
            return None
        return new if new.after.force < new.before.force else None

    @property
    def usable_replay(self) -> Replayed | NoReplayCheck | None:
        """Of the model to predict with."""
        new = self.update_in_use
        return self.replayed if new is None else new.replayed

    @property
    def usable(self) -> Usable:
        """The model to predict with."""
        new = self.update_in_use
        if new is not None:
            return Usable(new.c, *new.present, self.usable_replay)
        additions = self.fit.present
        deviations = tuple(self.fit.deviations[a.effect.name] for a in additions)
        return Usable(self.fit.c, additions, deviations, self.usable_replay)

    @property
    def usable_neo_hooke(self) -> Usable | None:
        """Neo-Hooke; None where it was not kept."""
        return None if self.neo_hooke is None else Usable(self.neo_hooke, (), (), self.neo_hooke_replayed)

    @property
    def to_be_used(self) -> Everything:
        """That of which no effect is beyond its prior, where there is one."""
        return self.plausible or self

    @property
    def worse(self) -> tuple[str, ...]:
        """Which error of what was held out (fitted, where nothing was) is larger than that of the base: of 'force' and 'field'."""
        pairs = [(a, b) for a, b in zip(self.before, self.after, strict=True) if a is not None and b is not None]
        before, after = pairs[-1]
        return tuple(name for name in ("force", "field") if getattr(after, name) > getattr(before, name))

    @property
    def predicts(self) -> bool:
        """Whether neither is."""
        return not self.worse
