"""A whole diagnosis: base model, rounds of tests, all explanations weighed, and the verdict of both.

In: Experiments, what to hold out, priors. Out: `Discovery`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calibrate.data.experiment import Experiment
from calibrate.data.readings_between import with_readings
from calibrate.diagnosis.base_fit import prepare
from calibrate.diagnosis.base_functions import first_guess
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.evidence.decision import decided
from calibrate.diagnosis.evidence.levels import Level, StiffnessLevel, at_one_level
from calibrate.diagnosis.evidence.own_effects import own_effects, refined_levels, with_own_effects
from calibrate.diagnosis.evidence.posterior import uncertainty_of
from calibrate.diagnosis.evidence.priors import Priors, read_priors
from calibrate.diagnosis.evidence.weighing import weigh
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.problem import Mask, Problem
from calibrate.diagnosis.replayed.replay_verdict import Check, judged_by_replay
from calibrate.diagnosis.selection.dominant_effect import dominant_effect
from calibrate.diagnosis.selection.loop import close_loop
from calibrate.diagnosis.selection.rounds import Discovery, Doubt, Verdict
from calibrate.diagnosis.selection.thresholds import DEFAULT, Thresholds
from calibrate.diagnosis.selection.verdict import is_noise
from calibrate.diagnosis.twin import Replay, with_twins
from calibrate.effects import CATALOGUE, Effect
from calibrate.effects.effect import distinct
from calibrate.equations.equilibrium import Equilibrium
from calibrate.errors import WeakStrainError
from calibrate.fitting.noise.noise_check import NoiseCheck, with_checked_noise
from calibrate.fitting.resumable import SILENT, Resumable


def discover(
    experiments: Sequence[Experiment],
    hold_out: HoldOut | None = None,
    held: Sequence[Experiment] = (),
    effects: Sequence[Effect] = CATALOGUE,
    spacing: float | None = None,
    base: str = "positive",
    seed: int = 0,
    say: Resumable = SILENT,
    thresholds: Thresholds = DEFAULT,
    priors: Priors | None = None,
    fitted: bool = True,
    replay: Replay | None = None,
    readings: int = 0,
    check: Check | None = None,
    few_effects: bool = True,
) -> Discovery:
    """Fit `experiments`, hold out equations of them and all of the experiments `held`, and find what is missing.

    hold_out: see `HoldOut.default`. spacing: of the virtual fields, mm (None: from the noise). base: see `base_fit.prepare`. replay: solves a
    test by finite elements, so that its discretisation error is known (`twin`); None: it is allowed for. readings: parts of each interval between
    pictures at whose ends the force of the machine record is used, see `readings_between`. Of several tests each may have a warp, a gradient, ... of its own,
    which the weights allow for (`own_effects`), and where no thickness is known a level of its own (`levels`). Where a flexible base follows the noise of a weak strain, neo-Hooke takes its place. Others: see `diagnose`. Raises `FitError` for a base that does not converge, `ConfigError`, and the errors of
    `calibrate.equations.equilibrium.equilibrium`.
    """
    hold_out = hold_out or HoldOut.default(min(e.n_increments for e in experiments), bool(held))
    priors = priors or read_priors()
    make = partial(_start, experiments, hold_out, held, effects, spacing, base, say, priors, replay, readings)
    start = say.checkpointed("base model", make)
    found = diagnose(start.problem, start.base, effects, seed, say, thresholds, priors, fitted, check, few_effects)
    return replace(
        found,
        noise=start.noise,
        without_twin=start.without_twin,
        own=tuple(one for one in found.own if not isinstance(one.effect, StiffnessLevel)),
        levels=refined_levels(start.levels, found.own),
        one_modulus=start.one_modulus,
    )


@dataclass(frozen=True, eq=False)
class _Start:
    """Weighted equations and base fit of a diagnosis; see `Discovery`."""

    problem: Problem
    base: Fit
    noise: tuple[NoiseCheck, ...]
    levels: tuple[Level, ...]
    without_twin: tuple[str, ...]
    one_modulus: bool


def _start(
    experiments: Sequence[Experiment],
    hold_out: HoldOut,
    held: Sequence[Experiment],
    effects: Sequence[Effect],
    spacing: float | None,
    base: str,
    say: Resumable,
    priors: Priors,
    replay: Replay | None,
    readings: int,
) -> _Start:
    """See `discover`."""
    say("noise")
    checked = [with_checked_noise(e) for e in (*experiments, *held)]
    say("base model")
    train = [hold_out.training] * len(experiments) + [_nothing] * len(held)
    tests = [with_readings(e, readings, 0) if readings else e for e, _ in checked]
    tests[: len(experiments)], levels = at_one_level(tests[: len(experiments)], hold_out.training, spacing)
    try:
        problem, state = prepare(tests, train, spacing, base=base)
        one_modulus = False
    except WeakStrainError:
        problem, state = prepare(tests, train, spacing, base="neo-Hooke")
        one_modulus = True
    without_twin: tuple[str, ...] = ()
    if replay is not None:
        say("replay of the base model")
        problem, state, without_twin = with_twins(problem, state, replay)
    if len(problem.trained) > 1:
        problem, state = with_own_effects(problem, state, distinct(effects), priors)
    return _Start(problem, state, tuple(check for _, check in checked), levels, without_twin, one_modulus)


def diagnose(
    problem: Problem,
    base: Fit,
    effects: Sequence[Effect] = CATALOGUE,
    seed: int = 0,
    say: Resumable = SILENT,
    thresholds: Thresholds = DEFAULT,
    priors: Priors | None = None,
    fitted: bool = True,
    check: Check | None = None,
    few_effects: bool = True,
) -> Discovery:
    """Rounds from a base fit, the verdict in the light of all explanations, and where none explains the test few effects by the fields of replays, but where a prior alone speaks against a model.

    priors: of amplitudes, None for the default. fitted: whether
    the best explanations are fitted and change the verdict. check: replays base and final model, which may change the verdict, too. few_effects: whether they are looked for there, which changes no verdict (not without `fitted` and `check`).
    """
    effects, priors = distinct(effects), priors or read_priors()
    found = close_loop(problem, base, effects, seed, say, thresholds)
    weighing = say.checkpointed("evidence", partial(weigh, found, priors, effects, fitted, say))
    found = decided(found, weighing, priors, effects, seed, say)
    found = replace(found, own=own_effects(found.problem, found.final, priors))
    if check is not None:
        say("replay of base and final model")
        found = judged_by_replay(found, say.checkpointed("replay", partial(check, found)))
    found = replace(found, uncertainty=uncertainty_of(found, priors))
    if fitted:
        found = replace(found, dominant=dominant_effect(found, say))
    if check is None or not (fitted and few_effects) or found.verdict is not Verdict.NOT_EXPLAINED:
        return found
    if _only_a_prior_speaks_against(found):
        return found  # few effects would be held within the same priors, and leave what this model does not
    say("the verdict is there: not explained; few effects by the fields of replays, for a model to predict with")
    neo_hooke = first_guess([(part.assembled, part.train.rows) for part in found.problem.trained])
    few = say.checkpointed("few effects", partial(check.few_effects, found, neo_hooke, effects, priors, say))
    return replace(found, few=few)


def _only_a_prior_speaks_against(found: Discovery) -> bool:
    """Whether the model leaves no more than noise, and all that is wrong with it is an amplitude that nobody expects."""
    alone = found.confirmation is not None and found.confirmation.doubts == (Doubt.BEYOND_PRIOR,)
    return alone and is_noise(found.problem, found.rounds[-1], found.thresholds)


def _nothing(system: Equilibrium) -> Mask:
    return np.zeros(system.loads.shape, bool)
