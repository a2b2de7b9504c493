"""How often the diagnosis was right in blind trials: judged trials in, counts over all and for each effect out.

A strong effect is one with a score above `GLOBAL_LIMIT`. Those that were hidden alone end in one of six ways, see `Ending`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from calibrate.diagnosis.selection import Verdict
from calibrate.models.parameter_covariance import Z95
from studies.trials.blind_case import GLOBAL_LIMIT
from studies.trials.judgement import JudgedTrial
from studies.trials.reliability import Reliability, Replaced, reliability, replaced

FIELD = "stiffness field"
CLEAR = 100.0  # score of either of two effects beside the other, from which the lesser is no small thing


class Ending(StrEnum):
    """How a trial with one effect ended: named right, and nothing else; right with a wrong name beside it; only an effect named that
    the data cannot tell from it; not explained, and the dominant effect, or one that leaves little more; nothing named; a wrong name only, named or
    dominant."""

    RIGHT = "right"
    BESIDE = "beside"
    GROUP = "group"
    DOMINANT = "dominant"
    MISSED = "missed"
    WRONG = "wrong"


def ending(one: JudgedTrial) -> Ending:
    """Of a judged trial with one effect."""
    if one.exact[0]:
        return Ending.BESIDE if set(one.named) - set(one.hidden) else Ending.RIGHT
    if one.hit[0]:
        return Ending.GROUP
    if one.named or not one.dominant:
        return Ending.WRONG if one.named else Ending.MISSED
    return Ending.DOMINANT if one.hidden[0] in one.dominant else Ending.WRONG


@dataclass(frozen=True)
class Endings:
    """Numbers of strong trials that ended in each way."""

    right: int = 0
    beside: int = 0
    group: int = 0
    dominant: int = 0
    missed: int = 0
    wrong: int = 0

    @classmethod
    def of(cls, trials: Sequence[JudgedTrial]) -> Endings:
        """Of judged trials with one effect."""
        return cls(**Counter(str(ending(one)) for one in trials))

    @property
    def strong(self) -> int:
        """All of them."""
        return self.group_named + self.dominant + self.missed + self.wrong

    @property
    def named(self) -> int:
        """Those in which the effect itself is named."""
        return self.right + self.beside

    @property
    def group_named(self) -> int:
        """Those in which it or one that the data cannot tell from it is named."""
        return self.named + self.group


@dataclass(frozen=True)
class Removed:
    """Strong trials diagnosed once more without their effect in the catalogue. explained: with this verdict; alike: of these by the
    name of a declared look-alike; wrong: with a name that is none. dominant: not explained, with a dominant effect; dominant_alike: of these a declared look-alike, or with one that leaves little more."""

    trials: int
    explained: int
    alike: int
    wrong: int
    dominant: int = 0
    dominant_alike: int = 0

    @classmethod
    def of(cls, strong: Sequence[JudgedTrial]) -> Removed:
        """Of those that were diagnosed once more."""
        absent = [one.absent for one in strong if one.absent is not None]
        explained = [a for a in absent if a.verdict == Verdict.EXPLAINED]
        alike = sum(not a.wrong for a in explained)
        traced = [bool(set(a.dominant) & set(a.partners)) for a in absent if a.dominant]
        return cls(len(absent), len(explained), alike, sum(bool(a.wrong) for a in absent), len(traced), sum(traced))


@dataclass(frozen=True)
class EffectSummary:
    """Trials with one effect. rms_pull: root mean square of the errors of its amplitudes over their stated deviations, where it is named; None
    where it never is. absent, absent_wrong: diagnosed without it in the catalogue, strong or not, and given a wrong name."""

    effect: str
    trials: int
    endings: Endings
    wrong: int
    unnamed: int
    amplitudes: int
    amplitudes_within: int
    rms_pull: float | None
    removed: Removed
    absent: int
    absent_wrong: int

    @classmethod
    def of(cls, effect: str, own: Sequence[JudgedTrial]) -> EffectSummary:
        """Of all judged trials with this effect alone."""
        strong = [one for one in own if one.strong]
        found = [p for one in own for p in pulls(one)]
        every = _field_pulls(own) if effect == FIELD else found
        rms = float(np.sqrt(np.mean(np.square(every)))) if every else None
        absent = [one.absent for one in own if one.absent is not None]
        return cls(
            effect, len(own), Endings.of(strong), sum(ending(one) == Ending.WRONG for one in own),
            sum(not one.named for one in own), len(found), sum(abs(p) < Z95 for p in found), rms, Removed.of(strong),
            len(absent), sum(bool(a.wrong) for a in absent),
        )  # fmt: skip

    def row(self) -> list[Any]:
        """A line of the table, see `EFFECT_COLUMNS`."""
        e = self.endings
        return [
            self.effect, self.trials, e.strong, e.right, e.beside, e.group, e.dominant, e.missed, e.wrong, self.wrong, self.unnamed,
            self.amplitudes, self.amplitudes_within, self.rms_pull, self.removed.trials, self.removed.explained, self.absent,
            self.absent_wrong,
        ]  # fmt: skip


EFFECT_COLUMNS = [
    "effect", "trials", "strong", "named right (strong)", "with a wrong name beside", "only its group", "dominant only", "missed", "wrong only",
    "wrong (all)", "not named (all)", "amplitudes", "within 95 %", "rms pull", "removed: strong", "removed: explained (strong)",
    "removed: trials", "removed: wrong name",
]  # fmt: skip


@dataclass(frozen=True)
class TrialSummary:
    """Counts over all trials. pairs: two effects, each strong beside the other; pairs_found: both in the groups of what is named; pairs_right: both named themselves; pairs_clear, pairs_clear_found: the same, of those with a score above `CLEAR` each; pairs_at_first: each strong before either is found.
    fields: coefficients of stiffness fields. seconds: CPU time of a diagnosis, median. reliability: of the probabilities."""

    trials: int
    nulls: int
    null_detections: int
    null_names: int
    endings: Endings
    amplitudes: int
    amplitudes_within: int
    absent: int
    absent_wrong: int
    removed: Removed
    pairs: int
    pairs_found: int
    pairs_right: int
    pairs_clear: int
    pairs_clear_found: int
    pairs_at_first: int
    pairs_at_first_found: int
    pairs_in_model: int
    field_correlation: float | None
    fields: int
    fields_within: int
    seconds: float
    effects: tuple[EffectSummary, ...]
    reliability: tuple[Reliability, ...]
    replaced: Replaced

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)


def summary(trials: Sequence[JudgedTrial]) -> TrialSummary:
    """Counts over judged trials, see `judgement.judge`."""
    nulls = [one for one in trials if not one.hidden]
    pairs = [one for one in trials if len(one.hidden) == 2]
    beside, clear = (
        [one for one in pairs if one.beside is not None and min(one.beside.values()) > limit]
        for limit in (GLOBAL_LIMIT, CLEAR)
    )
    at_first = [one for one in pairs if min(one.scores.values()) > GLOBAL_LIMIT]
    single = [one for one in trials if len(one.hidden) == 1]
    names = sorted({one.hidden[0] for one in single})
    effects = [EffectSummary.of(name, [one for one in single if one.hidden[0] == name]) for name in names]
    strong = [one for one in single if one.strong]
    correlations = [f for one in trials for f in one.field if f is not None]
    coefficients = _field_pulls(single)
    return TrialSummary(
        trials=len(trials),
        nulls=len(nulls),
        null_detections=sum(one.verdict != Verdict.NOTHING_SIGNIFICANT for one in nulls),
        null_names=sum(bool(one.named) for one in nulls),
        endings=Endings.of(strong),
        amplitudes=sum(e.amplitudes for e in effects),
        amplitudes_within=sum(e.amplitudes_within for e in effects),
        absent=sum(e.absent for e in effects),
        absent_wrong=sum(e.absent_wrong for e in effects),
        removed=Removed.of(strong),
        pairs=len(beside),
        pairs_found=sum(all(one.hit) for one in beside),
        pairs_right=sum(all(one.exact) for one in beside),
        pairs_clear=len(clear),
        pairs_clear_found=sum(all(one.hit) for one in clear),
        pairs_at_first=len(at_first),
        pairs_at_first_found=sum(all(one.hit) for one in at_first),
        pairs_in_model=sum(_in_model(one) for one in beside),
        field_correlation=float(np.median(correlations)) if correlations else None,
        fields=len(coefficients),
        fields_within=sum(abs(pull) <= Z95 for pull in coefficients),
        seconds=float(np.median([one.seconds for one in trials])) if trials else 0.0,
        effects=tuple(effects),
        reliability=reliability(trials),
        replaced=replaced(trials),
    )


def _in_model(one: JudgedTrial) -> bool:
    """Whether all hidden effects are named, or in the model and too small beside another to be named."""
    return all(hit or name in one.closest for name, hit in zip(one.hidden, one.hit, strict=True))


def pulls(one: JudgedTrial) -> list[float]:
    """Of the amplitudes of hidden effects that were named, but those that are none, as of a warp along an axis that was not bent; a field's coefficients, which cannot follow a patch, are not among
    them."""
    found = [a for a in one.amplitudes if a is not None and a.effect in one.named and a.effect != FIELD]
    return [p for a in found for name, p in a.pulls.items() if a.true[name] != 0.0]


def _field_pulls(single: Sequence[JudgedTrial]) -> list[float]:
    """Of the coefficients of hidden stiffness fields."""
    found = (a for one in single if one.hidden == [FIELD] for a in one.amplitudes if a is not None)
    return [pull for a in found if a.effect == FIELD for pull in a.pulls.values()]
