"""The verdict of a discovery: numbers for the template ``discovery.txt`` in, what report and terminal say out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from calibrate.diagnosis.distillation import Distilled
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.replayed.few_effects import FewEffects
from calibrate.diagnosis.selection import Verdict
from calibrate.diagnosis.selection.rounds import DominantEffect, Doubt, Round, Unexpected
from calibrate.models.addition_json import amplitude_unit
from calibrate.models.fitness import Use
from calibrate.models.parameter_covariance import Z95
from studies.output.words import plus_minus, with_unit
from studies.reports.discovery.candidate_outcome import WORDS, outcome_words
from studies.reports.discovery.discovery_quality import discovery_headline, others_hold
from studies.reports.discovery.records import told_shapes
from studies.reports.discovery.replays.few_effects_table import few_data
from studies.reports.discovery.replays.replayed_models import recommendation
from studies.reports.discovery.view import View

LISTED = 3  # amplitudes that a cell of the table can hold


@dataclass(frozen=True)
class NamedEffect:
    """An effect of the final model: its amplitudes and shapes as text, and the effects it cannot be told from. probabilities: see `View.inclusion`."""

    name: str
    values: tuple[str, ...]
    like: tuple[str, ...]
    probabilities: Mapping[str, float]


@dataclass(frozen=True)
class ErrorChange:
    """Errors of force and field of the base and the final model, on data held out, or fitted where none were."""

    force_before: float
    force_after: float
    field_before: float
    field_after: float
    held_out: bool
    hold_out: str


@dataclass(frozen=True)
class Residual:
    """The residual of the last model against noise. telling: the test with the smallest p, where it says more than that of all
    equations. predicted_p: of what was held out, None where nothing was. more_than_noise: fitted or held out."""

    noise_is_known: bool
    more_than_noise: bool
    fitted_more_than_noise: bool
    reduced_chi_square: float
    p_value: float
    telling: str | None
    predicted_p: float | None


@dataclass(frozen=True)
class BestCandidate:
    """The candidate of the last round with the smallest adjusted p. limit: below which it is significant."""

    name: str
    p_value: float
    significant: bool
    outcome: str
    limit: float


@dataclass(frozen=True)
class Statement:
    """All that the verdict says. last_step: of a last fit that has not converged, in standard deviations of an equation.
    doubts: why what is closest is no explanation; force_allowed: force error that one may leave; beyond_prior: amplitudes that nobody expects. level_is_nominal: whether only ratios
    of stiffness are known. dominant: what most of a misfit that is not explained is traced to. against: why the model is not to be used, and no test of an effect is to be believed."""

    verdict: Verdict
    named: tuple[NamedEffect, ...]
    closest: tuple[NamedEffect, ...]
    errors: ErrorChange
    residual: Residual
    best: BestCandidate | None
    decided_by: tuple[str, ...]
    may_be_false_alarm: bool
    last_step: float | None
    doubts: tuple[Doubt, ...] = ()
    force_allowed: float = float("nan")
    level_is_nominal: bool = False
    against: tuple[str, ...] = ()
    dominant: DominantEffect | None = None
    beyond_prior: tuple[Unexpected, ...] = ()

    @property
    def force_after(self) -> float:
        """Force error of the final model."""
        return self.errors.force_after

    @classmethod
    def of(cls, view: View) -> Statement:
        """Of a discovery."""
        found, final = view.discovery, view.discovery.final
        residual, use = _residual(view), discovery_headline(view)
        return cls(
            found.verdict,
            _effects(view, found.named),
            _effects(view, found.closest),
            _errors(view),
            residual,
            _best(view),
            _deciding(view),
            residual.noise_is_known and not residual.more_than_noise,
            None if final.converged else final.last_step,
            () if found.confirmation is None else found.confirmation.doubts,
            float("nan") if found.confirmation is None else found.confirmation.force_allowed,
            found.problem.level_is_nominal,
            use.in_words if use.verdict is Use.NOT else (),
            found.dominant,
            () if found.confirmation is None else found.confirmation.beyond_prior,
        )


def clauses(view: View) -> list[str]:
    """The verdict in words, then what it rests on; also that the last fit has not converged, if so."""
    return [part.strip() for part in WORDS.verdict(s=Statement.of(view)).split("||")]


def verdict(view: View) -> str:
    """The same as one sentence."""
    return "; ".join(clauses(view))


def use_of_models(view: View) -> list[str]:
    """Where nothing explains the test, what comes nearest; which model to predict with, and what to know of model.json; nothing where no model of these data is to be used."""
    use = discovery_headline(view)
    if not others_hold(view):
        return []
    own = [f"model.json: {use.text[0].lower()}{use.text[1:]}"] if use.verdict is Use.RESERVATIONS else []
    few = view.discovery.few
    nearest = [WORDS.nearest(**few_data(few))] if isinstance(few, FewEffects) and few.best is not None else []
    return [*nearest, recommendation(view.discovery), *own]


def _effects(view: View, names: tuple[str, ...]) -> tuple[NamedEffect, ...]:
    final, groups = view.discovery.final, view.discovery.groups
    return tuple(
        NamedEffect(
            name, tuple(effect_values(final, i, view.unit, view.level)), groups.get(name, (name,))[1:], view.inclusion
        )
        for i, name in enumerate(final.names)
        if name in names
    )


def effect_values(fit: Fit, i: int, unit: str, level: float = 1.0) -> list[str]:
    """Amplitudes of the i-th effect with half their 95 % interval, and its shapes: 'c01 = 0.0163 +- 0.0006 MPa'. level: by which
    stiffness is multiplied."""
    addition, deviations = fit.additions[i], fit.deviations[i]
    values = [
        with_unit(
            f"{p.name} = {plus_minus(v * level**p.stiffness_power, Z95 * d * level**p.stiffness_power)}",
            amplitude_unit(p, unit),
        )
        for p, v, d in zip(addition.effect.amplitudes, addition.amplitudes, deviations, strict=True)
    ]
    if len(values) > LISTED:
        values = [WORDS.amplitudes(n=len(values))]
    place = addition.effect.located(fit.chains[0].data, addition.shape) if fit.chains else ""
    if place:
        return [*values, place]
    return values + [with_unit(f"{s.name} = {s.value:.3g}", s.unit) for s in
                     told_shapes(addition.effect, addition.shape, unit)]  # fmt: skip


def _errors(view: View) -> ErrorChange:
    (first, before), (last, after) = view.errors
    held = before is not None and after is not None
    before, after = before or first, after or last
    return ErrorChange(before.force, after.force, before.field, after.field, held, view.hold_out)


def _residual(view: View) -> Residual:
    found, now = view.discovery, view.discovery.rounds[-1]
    limit, tests = found.thresholds.misfit_p, now.misfits._asdict()
    smallest = min(tests, key=lambda name: tests[name].p_value)
    telling = smallest if smallest != "everything" and now.misfits.p_value < limit else None
    return Residual(
        found.problem.noise_is_known,
        min(now.misfits.p_value, now.predicted_p) < limit,
        now.misfits.p_value < limit,
        now.fit.reduced_chi_square,
        now.misfits.p_value,
        telling,
        None if now.predicted is None else now.predicted_p,
    )


def _best(view: View) -> BestCandidate | None:
    now, thresholds = view.discovery.rounds[-1], view.discovery.thresholds
    tested = [c for c in now.candidates if c.score.is_tested]
    if not tested:
        return None
    best = min(tested, key=lambda c: c.score.adjusted)
    return BestCandidate(
        best.name,
        best.score.adjusted,
        best.is_significant(thresholds),
        outcome_words(best, now, thresholds),
        thresholds.significance,
    )


def _deciding(view: View) -> tuple[str, ...]:
    """The experiments that would break the ties of what is named; none where there is no tie."""
    found = view.discovery
    known = {c.name: c.score.effect for now in found.rounds for c in now.candidates}
    groups = [found.groups.get(name, (name,)) for name in found.named]
    tests = [known[n].decided_by for group in groups if len(group) > 1 for n in group if n in known]
    return tuple(dict.fromkeys(test for test in tests if test))


def untestable(now: Round) -> list[str]:
    """What these data cannot support: 'force gain: confounded, cannot be told from ...'."""
    return [
        WORDS.untestable(name=c.name, outcome=outcome_words(c, now)) for c in now.candidates if not c.score.is_tested
    ]


def network_words(distilled: Distilled) -> str:
    """How well the network of a model file stands in for its base."""
    network, spline = distilled.chi_squares
    return WORDS.network(chi_square=network, spline_chi_square=spline, good=distilled.good)
