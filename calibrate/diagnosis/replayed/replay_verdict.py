"""The verdict in the light of the replay.

In: a `Discovery` and what its replay came to. Out: the `Discovery` that both allow: *explained* needs a replay of what was held out within its band, and none
that is worse than that of the base. A replay that was not made changes no verdict.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.evidence.priors import Priors
from calibrate.diagnosis.problem import level_factor
from calibrate.diagnosis.replayed.checked_replay import NoReplayCheck, ReplayCheck, Replayed
from calibrate.diagnosis.replayed.few_effects import FewEffects
from calibrate.diagnosis.selection.rounds import Discovery, Doubt
from calibrate.effects import Effect
from calibrate.effects.chain import Additions
from calibrate.fitting.resumable import Resumable

Array = NDArray[np.float64]


class Check(Protocol):
    """Replays of a diagnosis."""

    def __call__(self, found: Discovery) -> ReplayCheck | NoReplayCheck:
        """Of its base and final model."""
        ...

    def few_effects(
        self, found: Discovery, c: Array, effects: Sequence[Effect], priors: Priors, say: Resumable
    ) -> FewEffects | NoReplayCheck:
        """Those that leave least of the fields beside neo-Hooke, c (n,), MPa, at any level, updated by forces, and the replays of both."""
        ...


def judged_by_replay(found: Discovery, check: ReplayCheck | NoReplayCheck) -> Discovery:
    """With the check; *not explained* where it speaks against an explanation."""
    found = replace(found, replay_check=check)
    if isinstance(check, NoReplayCheck) or not check.judgement.speaks_against or not found.final.names:
        return found
    doubts = [Doubt.WORSE_REPLAY] if check.judgement.worse else []
    doubts += [Doubt.OUTSIDE_BAND] if check.judgement.outside else []
    return found.doubted(*doubts)


def stiffness_level(found: Discovery, fit: Fit) -> float:
    """By which the stiffness of the base or the final fit is multiplied: a nominal level; or that of its replayed forces, where it was replayed itself. Raises `FitError`, see
    `problem.level_factor`."""
    check = found.replay_check
    if found.problem.level_is_nominal or not isinstance(check, ReplayCheck):
        return level_factor(found.problem, fit.c, fit.additions)
    which = int(fit is found.final)
    return 1.0 if check.stand_ins[which] else (check.base, check.final)[which].level.factor


def replayed_level(
    found: Discovery, replayed: Replayed | NoReplayCheck | None, c: Array, additions: Additions
) -> float:
    """The same of another model of the diagnosis: base (n,) and effects. Raises `FitError`, see `problem.level_factor`."""
    if found.problem.level_is_nominal or not isinstance(replayed, Replayed):
        return level_factor(found.problem, c, additions)
    return replayed.level.factor
