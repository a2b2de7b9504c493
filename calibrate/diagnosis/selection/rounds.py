"""What a diagnosis finds round by round: tested effects, their fits, refusals, and the verdict. Plain data, computed elsewhere."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from typing import Any

from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.evidence.explanations import Power, Weighing
from calibrate.diagnosis.evidence.levels import Level
from calibrate.diagnosis.evidence.own_effects import OwnEffect
from calibrate.diagnosis.misfit import Misfit
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.replayed.checked_replay import NoReplayCheck, ReplayCheck
from calibrate.diagnosis.replayed.few_effects import FewEffects
from calibrate.diagnosis.residual_tests import ChiSquare, Misfits
from calibrate.diagnosis.score_tests import Score
from calibrate.diagnosis.selection.thresholds import DEFAULT, Thresholds
from calibrate.effects.chain import Addition
from calibrate.fitting.noise.noise_check import NoiseCheck
from calibrate.models.model_uncertainty import ModelUncertainty


class Verdict(StrEnum):
    """Result of a diagnosis; the values are those of model files."""

    EXPLAINED = "explained"
    NOTHING_SIGNIFICANT = "nothing significant"
    NOT_EXPLAINED = "significant, not explained"


class RefusalReason(StrEnum):
    """Why a significant effect is not added to the model."""

    INADMISSIBLE = "inadmissible amplitude"
    IMPOSSIBLE = "amplitudes that no body has together"
    UNTOLD = "shape that no test tells from farther ones"
    NO_BETTER_FIT = "no fit with it is better"
    DEGENERATE = "degenerate member of a family"
    NULL_AMPLITUDE = "amplitude not distinct from none"
    SOFT_BASE = "base with hardly any stiffness"
    LARGER_ERRORS = "larger errors with its own weights"
    HELD_OUT_NOT_BETTER = "error on held-out data does not fall"
    NO_ERROR_FALLS = "no error falls"
    LARGER_IN_OTHER_WEIGHTS = "errors fall in the weights of one model only"


@dataclass(frozen=True)
class Refusal:
    """A significant effect that was not added."""

    effect: str
    reason: RefusalReason


@dataclass(frozen=True)
class Exchange:
    """An effect that took the place of another, as it explains more beside the other effects."""

    removed: str
    added: str


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect in a round: its score, the fit with it (None where it was not made) and its errors.

    problem: the weights that the fit belongs to, where it was made to be compared. like: effects with a similar signature and the
    cosine, most similar first.
    """

    score: Score
    fit: Fit | None = field(default=None, repr=False)
    problem: Problem | None = field(default=None, repr=False)
    train: Misfit | None = None
    held: Misfit | None = None
    like: tuple[tuple[str, float], ...] = ()

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.score.effect.name

    @property
    def decided(self) -> Candidate:
        """What is kept of it when the round is over: no weights, no chains, from which nothing goes on."""
        return replace(self, problem=None, fit=None if self.fit is None else replace(self.fit, chains=()))

    @property
    def addition(self) -> Addition | None:
        """The effect as it was fitted; None where it was not."""
        return None if self.fit is None else self.fit.additions[-1]

    @property
    def deviations(self) -> tuple[float, ...]:
        """A standard deviation for each fitted amplitude, in its unit; none where it was not fitted."""
        return () if self.fit is None else self.fit.deviations[-1]

    def is_significant(self, thresholds: Thresholds) -> bool:
        """Whether it was tested and its adjusted p-value is small."""
        return self.score.is_tested and self.score.adjusted < thresholds.significance


@dataclass(frozen=True, eq=False)
class Round:
    """A model, its errors, the tests of its residual, and the effect that was added (None: nothing), with its group.

    predicted: chi-square test of what was held out, see `residual_tests.prediction_test`.
    """

    fit: Fit
    train: Misfit
    held: Misfit | None
    misfits: Misfits
    candidates: tuple[Candidate, ...]
    predicted: ChiSquare | None = None
    added: str | None = None
    group: tuple[str, ...] = ()
    refusals: tuple[Refusal, ...] = ()
    exchange: Exchange | None = None

    @property
    def predicted_p(self) -> float:
        """Probability of a prediction as bad, if the model is right; 1 where nothing is held out."""
        return 1.0 if self.predicted is None else self.predicted.p_value


@dataclass(frozen=True)
class Review:
    """Effects of a model, each taken out in turn. gains: by how much the misfit then rises. groups: others for its place."""

    gains: dict[str, float] = field(default_factory=dict)
    groups: dict[str, tuple[str, ...]] = field(default_factory=dict)


class Doubt(StrEnum):
    """Why effects that reduce the residual to noise are no explanation."""

    ERRORS_GROW = "force or field error grows"
    NO_CLEAR_FALL = "no error falls clearly"
    OTHER_WEIGHTS = "errors fall in the weights of one model only"
    LARGE_FORCE_ERROR = "large force error left"
    NO_LIKELIER = "likelihood does not rise"
    AT_BOUNDS = "amplitude at the end of what is possible"
    NOT_NEEDED = "no effect has an inclusion probability above 95 %"
    OUTSIDE_BAND = "replay leaves its band"
    WORSE_REPLAY = "replay worse than that of the base"
    BEYOND_PRIOR = "amplitude beyond three standard deviations of its prior"


@dataclass(frozen=True)
class Unexpected:
    """An amplitude of an effect that nobody expects: so many standard deviations of its prior. std: that in its table of priors, of what it is a multiple there; needed: the least that
    would expect it. None where its table has no prior."""

    effect: str
    amplitude: str
    deviations: float
    std: float | None = None
    of: str = ""
    needed: float | None = None


@dataclass(frozen=True)
class Confirmation:
    """Errors of base and final model, held out, or fitted where nothing was (of forces where none was), of several tests beside what each has for itself. doubts: conditions that fail.

    force_allowed: force error that an explanation may leave; NaN where no force is among these equations. beyond_prior: amplitudes that nobody expects.
    """

    before: Misfit
    after: Misfit
    force_allowed: float
    doubts: tuple[Doubt, ...]
    beyond_prior: tuple[Unexpected, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """As discovery.json holds it."""
        return {
            "before": self.before.to_dict(),
            "after": self.after.to_dict(),
            "force_error_allowed": self.force_allowed,
            "doubts": [str(doubt) for doubt in self.doubts],
            "beyond_prior": [asdict(one) for one in self.beyond_prior],
        }


@dataclass(frozen=True)
class DominantEffect:
    """What most of a misfit is traced to that nothing explains. share: of the misfit beyond noise, that the effect alone takes; like: effects that
    alone leave little more, best first."""

    effect: str
    share: float
    like: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Discovery:
    """Result of `discover`.

    named: effects that the residual confirms; closest: those added that it does not. groups: for each added effect, the effects
    that these data cannot tell from it. confirmation: of the final model against the base, where it has effects. noise: of every
    experiment, stated and found; empty where it was not looked at. start: with the weights of the base. weighing: of all
    explanations. replaced: effects that the rounds had found before a more probable explanation took their place. few: effects that leave least of the fields of a
    replay, where nothing explains the test. without_twin: why tests were not replayed. own: what
    every one of several tests has for itself. levels: of several tests whose thicknesses are unknown; empty where these are known.
    replay_check: of base and final model; None where it was not asked for. dominant: of a test that is not explained; None where nothing is. one_modulus:
    whether the base is neo-Hooke because a flexible one followed the noise of a weak strain. uncertainty: of the final model.
    """

    problem: Problem = field(repr=False)
    rounds: tuple[Round, ...]
    verdict: Verdict
    named: tuple[str, ...]
    closest: tuple[str, ...]
    groups: dict[str, tuple[str, ...]]
    thresholds: Thresholds = DEFAULT
    confirmation: Confirmation | None = None
    noise: tuple[NoiseCheck, ...] = ()
    start: Problem | None = field(default=None, repr=False)
    weighing: Weighing | None = field(default=None, repr=False)
    replaced: tuple[str, ...] | None = None
    few: FewEffects | NoReplayCheck | None = field(default=None, repr=False)
    without_twin: tuple[str, ...] = ()
    own: tuple[OwnEffect, ...] = ()
    levels: tuple[Level, ...] = ()
    replay_check: ReplayCheck | NoReplayCheck | None = field(default=None, repr=False)
    dominant: DominantEffect | None = None
    one_modulus: bool = False
    uncertainty: ModelUncertainty | None = field(default=None, repr=False)

    @property
    def powers(self) -> tuple[Power, ...]:
        """What the test shows of every effect; nothing where explanations were not weighed."""
        found = () if self.weighing is None else self.weighing.powers
        if self.verdict is Verdict.NOT_EXPLAINED:
            return tuple(one.beside_a_misfit for one in found)
        return tuple(one.unnamed if one.effect.name in self.closest else one for one in found)

    @property
    def base(self) -> Fit:
        """The fit without effects."""
        return self.rounds[0].fit

    @property
    def final(self) -> Fit:
        """The last fit: the base with the effects `named` and `closest`."""
        return self.rounds[-1].fit

    def doubted(self, *doubts: Doubt, beyond_prior: tuple[Unexpected, ...] = ()) -> Discovery:
        """With what speaks against its effects: no explanation any more. beyond_prior: see `Confirmation`."""
        confirmation = self.confirmation
        if confirmation is not None:
            every, beyond = (*confirmation.doubts, *doubts), (*confirmation.beyond_prior, *beyond_prior)
            confirmation = replace(confirmation, doubts=every, beyond_prior=beyond)
        if self.verdict is not Verdict.EXPLAINED:
            return replace(self, confirmation=confirmation)
        verdict, closest = Verdict.NOT_EXPLAINED, self.final.names
        return replace(self, verdict=verdict, named=(), closest=closest, confirmation=confirmation)
