"""Alerts: every sentence has one code and a place on the page; each is made here by the data that call for it."""

from __future__ import annotations

import ast
import json
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from unittest import mock

import numpy as np
import pytest
from discoveries import explained, nothing, sheet
from discoveries import view as seen
from made_up_replay import check, observations, only_held
from skip_network import neo_hooke

from calibrate.data.chosen_pictures import chosen
from calibrate.data.experiment import Experiment, Noise
from calibrate.data.strain_signal import StrainSignal
from calibrate.diagnosis.evidence.explanations import Alternatives, Explanation, Power, Weighing
from calibrate.diagnosis.evidence.levels import Level
from calibrate.diagnosis.evidence.own_effects import OwnEffect
from calibrate.diagnosis.evidence.power import Finding as PowerFinding
from calibrate.diagnosis.replayed.checked_replay import NoReplayCheck
from calibrate.diagnosis.replayed.few_effects import FewEffects, FewModel, FittedSet
from calibrate.diagnosis.replayed.observations import ReplayErrors as ErrorsOfReplay
from calibrate.diagnosis.replayed.parameter_spread import Directions, Spread
from calibrate.diagnosis.replayed.updating import Updated
from calibrate.diagnosis.residual_tests import ChiSquare
from calibrate.diagnosis.selection.rounds import DominantEffect, Doubt, Refusal, RefusalReason, Verdict
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.effects.second_invariant import SecondInvariant
from calibrate.effects.stiffness_gradient import StiffnessGradient
from calibrate.effects.upturn import Upturn
from calibrate.effects.viscosity import Viscosity
from calibrate.equations.basis import SingleBasis
from calibrate.fitting.classical_fit import Comparison
from calibrate.fitting.noise.noise_check import NoiseCheck
from calibrate.models.diagnosed_law import DiagnosedLaw
from calibrate.models.extended_model import ExtendedModel
from calibrate.models.fitness import Fitness, Use
from calibrate.models.model_uncertainty import ModelUncertainty
from calibrate.models.parameter_covariance import Uncertainty
from studies.commands.discover import read as read_experiments
from studies.decide.report import DecideCode
from studies.errors import AlertError
from studies.output.alerts import Severity, alert_of, read, registry
from studies.output.findings import Finding, Macro
from studies.output.report import Report
from studies.output.words import percent
from studies.output.writing import plain
from studies.replay import report as replay_report
from studies.reports.alert_table import COLUMNS, add_alerts, alert_lines, alert_records, in_order
from studies.reports.calibration import classical_table, fit_findings
from studies.reports.calibration.polish_record import Kept, PolishRecord, ReplayErrors
from studies.reports.discovery import discovery_findings, discovery_quality
from studies.reports.discovery.discovery_findings import remarks
from studies.reports.experiments.experiment_findings import experiment_findings, noise_found
from studies.reports.headline import LIMITS, Quality, Reason, headline
from studies.reports.prediction import predicted_curves
from studies.reports.prediction.predicted_forces import Forecast
from studies.reports.supervised.curve_calibration import CurveCode
from studies.sheets.report import SheetCode
from studies.transfer.report import TransferCode

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "alerts.md").read_text()
MACROS = [macro for alert in registry().values() for macro in alert.macros]
Findings = Iterable[Finding]

# --- headline -------------------------------------------------------------------------------------------------

GOOD = Quality((StrainSignal(0.1, 0.01, 0),), level_is_nominal=False, has_rim=False, force_error=0.01)


def reasons(**changes: Any) -> Findings:
    """Of a good calibration that was changed."""
    assert not headline(GOOD).reasons
    return headline(replace(GOOD, **changes)).reasons


WEAK = (StrainSignal(0.02, 0.01, 0),)
OF_HEADLINE: dict[str, Callable[[], Findings]] = {
    "headline.forces_missed": lambda: reasons(force_error=0.08, expected_error=0.06),
    "headline.forces_not_predicted": lambda: reasons(held_error=0.2),
    "headline.worse_than_one_modulus": lambda: reasons(force_error=0.04, neo_hooke_error=0.01),
    "headline.far_above_noise": lambda: reasons(reduced_chi_square=30.0),
    "headline.attenuated": lambda: reasons(attenuation=1.2),
    "headline.weak_strain": lambda: reasons(signals=WEAK),
    "headline.uncertain_stiffness": lambda: reasons(relative_deviation=0.2),
    "headline.dead_network": lambda: reasons(dead_network=True),
    "headline.few_starts": lambda: reasons(starts=20, alike=2),
    "headline.unbalanced": lambda: reasons(imbalance=0.1),
    "headline.only_ratios": lambda: reasons(level_is_nominal=True),
    "headline.unexplained": lambda: reasons(unexplained=True),
    "headline.unconverged": lambda: reasons(unconverged=True),
    "headline.is_the_force_that_of_the_section": lambda: reasons(force_error=0.08, has_rim=True),
}

# --- experiment and calibration -------------------------------------------------------------------------------


def poor_test(**changes: Any) -> Any:
    """An Experiment in plane strain without noise, time, thickness or balance of forces, as far as findings look at it."""
    known = {
        "name": "plate",
        "plane": "strain",
        "thickness": None,
        "force_imbalance": (0.2, 0.01),
        "n_increments": 5,
        "provenance": {},
        "is_biaxial": True,
    }
    return SimpleNamespace(**{**known, "level_is_nominal": False, **changes})


def review(chi_square: float | None = 1.0, **changes: Any) -> Any:
    """A `Review`, as far as findings look at it: nothing held out, no classical laws, forces missed by 1 %."""
    system = SimpleNamespace(level_equation=np.array([[False], [True]]))
    calibration = SimpleNamespace(reduced_chi_square=chi_square, losses=(1.0,) * 20, reason="converged", system=system)
    sheet = SimpleNamespace(fields=SimpleNamespace(boundary=np.array([0])), loads=np.full((5, 2), 2.0))
    known = {
        "system": sheet,
        "classical_forces": dict.fromkeys(("Yeoh", "Gent"), np.full((5, 2), 2.1)),  # of 2 N: missed by 5 %
        "chi_square": None if chi_square is None else np.ones(5),
        "fitted_chi_square": chi_square,
        "fitted": np.array([False, True, True, False, False]),
        "calibration": calibration,
        "starts_alike": 18,
        "experiment": poor_test(),
        "force_error": lambda increments: 0.01,
        "neo_hooke_error": 0.05,
        "held_out": None,
        "classical": None,
        "polish": None,
        "noise": None,
        "model": neo_hooke(),
        "measured": {"right": np.array([[0.0, 0.0]] * 4 + [[2.0, 0.0]])},
        "forces": {"right": np.array([[0.0, 0.0]] * 4 + [[1.5, 0.0]])},
    }
    return SimpleNamespace(**{**known, **changes})


def two_grips(right: float) -> dict[str, Any]:
    """Forces of 2 N on either side in the last increment that was fitted, of which the model has `right` on one."""
    sides = {"left": -1.0, "right": 1.0}
    course = np.array([0.0, 1.0, 2.0, 0.0, 0.0])[:, None] * [1.0, 0.0]
    measured = {name: sign * course for name, sign in sides.items()}
    return {"measured": measured, "forces": {**measured, "right": 0.5 * right * course}}


def law(name: str, criterion: float, converged: bool = True) -> Any:
    """A classical law that was fitted."""
    fit = SimpleNamespace(reason=SimpleNamespace(is_success=converged), stability=1.0)
    return SimpleNamespace(name=name, fit=fit, numbers=1, criterion=criterion, chi_square=criterion)


def laws(*found: Any) -> Any:
    return Comparison(100, 1.0, found[0], found)


STIFF = replace(neo_hooke(), parameters=1e4 * neo_hooke().parameters)  # as of kN for N, and Pa for MPa


def swapped(experiment: Any) -> Any:
    """With the last two pictures in another order than their forces."""
    return replace(experiment, displacements=experiment.displacements[[*range(experiment.n_increments - 2), -1, -2]])


ERRORS = ReplayErrors(100.0, 90, 0.01, 0.1)
POLISHED = PolishRecord(Kept.POLISHED, neo_hooke(), neo_hooke(), 2, ERRORS, ERRORS, ERRORS, ERRORS)
HELD = SimpleNamespace(increments=3, relative_force_error=0.02, chi_square_per_equation=1.1)
OF_CALIBRATION: dict[str, Callable[[], Findings]] = {
    "experiment.forces_do_not_balance": lambda: fit_findings.findings(review()),
    "experiment.against_the_force": lambda: experiment_findings(swapped(sheet()), True),
    "experiment.pictures_used": lambda: experiment_findings(chosen(sheet(), (1, 3)), True),
    "experiment.bulk_modulus_with_unknown_noise": lambda: fit_findings.findings(review(None)),
    "calibration.noise_unknown": lambda: fit_findings.findings(review(None)),
    "calibration.residuals_as_noise": lambda: fit_findings.findings(review(1.0)),
    "calibration.residuals_above_noise": lambda: fit_findings.findings(review(5.0)),
    "calibration.residuals_far_above_noise": lambda: fit_findings.findings(review(30.0)),
    "calibration.residuals_below_noise": lambda: fit_findings.findings(review(0.3)),
    "calibration.starts": lambda: fit_findings.findings(review()),
    "calibration.forces": lambda: fit_findings.findings(review()),
    "calibration.grips_differ": lambda: fit_findings.findings(review(**two_grips(1.5))),
    "calibration.not_soft": lambda: fit_findings.findings(review(model=STIFF)),
    "calibration.nominal_level": lambda: fit_findings.findings(review(experiment=poor_test(level_is_nominal=True))),
    "calibration.held_out": lambda: fit_findings.findings(review(held_out=HELD)),
    "calibration.polished": lambda: fit_findings.findings(review(polish=POLISHED)),
    "calibration.not_polished": lambda: fit_findings.findings(review(polish=replace(POLISHED, kept=Kept.WORSE))),
    "calibration.nothing_held_out": lambda: fit_findings.findings(review()),
    "calibration.classical_laws": lambda: fit_findings.findings(review(classical=laws(law("Yeoh", 2.0)))),
    "calibration.classical_not_fitted": lambda: fit_findings.findings(review(classical=laws(law("Yeoh", 2.0, False)))),
    "calibration.classical_not_compared": lambda: fit_findings.findings(review()),
    "calibration.thickness_unknown": lambda: fit_findings.findings(review()),
    "calibration.plane_strain": lambda: fit_findings.findings(review()),
    "curves.no_field": lambda: [Finding("curves", CurveCode.NO_FIELD)],
}

# --- discovery ------------------------------------------------------------------------------------------------


def of_nothing(**changes: Any) -> Findings:
    """Of the discovery on a plate in which nothing is hidden, changed."""
    return remarks(seen(replace(nothing(), **changes)))


def of_problem(**changes: Any) -> Findings:
    return of_nothing(problem=replace(nothing().problem, **changes))


def of_experiment(change: Callable[[Experiment], Experiment], **changes: Any) -> Findings:
    (part,) = nothing().problem.parts
    system = replace(part.system, experiment=change(part.experiment))
    parts = (replace(part, chain=replace(part.chain, system=system)),)
    return of_nothing(problem=replace(nothing().problem, parts=parts), **changes)


def of_two_tests(stiffer: float) -> Findings:
    """Of a test and another, as a copy of it whose forces are larger by a factor."""
    (one,) = nothing().problem.parts
    loaded = tuple(replace(b, force=stiffer * b.force) for b in one.experiment.loaded)
    system = replace(one.system, experiment=replace(one.experiment, name="other", loaded=loaded))
    return of_problem(parts=(one, replace(one, chain=replace(one.chain, system=system))))


def of_first_round(**changes: Any) -> Findings:
    first, *rest = nothing().rounds
    return of_nothing(rounds=(replace(first, **changes), *rest))


def of_weighing(unexplained: float = 0.7, inclusion: float = 0.2, **changes: Any) -> Findings:
    """Of a weighing as far as its sentences look at it: the second invariant or nothing, one effect invisible."""
    said = [SimpleNamespace(names=("second invariant",), discrepancy=False, probability=0.2),
            SimpleNamespace(names=(), discrepancy=True, probability=unexplained)]  # fmt: skip
    hidden = Power(Upturn(), PowerFinding.INVISIBLE, Upturn().amplitudes[0])
    alternatives = SimpleNamespace(
        explanations=said, inclusion={"second invariant": inclusion}, unexplained=unexplained
    )
    weighing = Weighing(cast(Any, alternatives), {}, (hidden,), fitted=True)
    return of_nothing(weighing=weighing, **changes)


def replaced(name: str) -> Findings:
    """The rounds were run on from a model with an effect."""
    assert explained().rounds[1].fit.names == (name,)
    return of_explained(replaced=("upturn",))


def of_explained(**changes: Any) -> Findings:
    """Of the discovery on a plate with a second invariant, changed."""
    return remarks(seen(replace(explained(), **changes)))


def of_inclusion(x: float, y: float, radius: float = 0.2) -> Findings:
    """Of an inclusion about a place, in extents from the middle of a plate with a hole there."""
    effect = next(one for one in CATALOGUE if one.name == "inclusion")
    *rounds, last = explained().rounds
    fit = replace(
        last.fit, additions=(Addition(effect, (0.2,), (x, y, radius, 0.0, 0.0, 0.0, 0.0)),), errors=((0.01,),)
    )
    return of_explained(rounds=(*rounds, replace(last, fit=fit)), groups={}, named=("inclusion",))


def of_strip() -> Findings:
    """Of a strip of 0.5 mm."""
    effect = next(one for one in CATALOGUE if one.name == "unmeasured strip")
    *rounds, last = explained().rounds
    fit = replace(last.fit, additions=(Addition(effect, (0.5,), ()),), errors=((0.1,),))
    return of_explained(rounds=(*rounds, replace(last, fit=fit)), groups={}, named=("unmeasured strip",))


def of_few(
    wrong: float | None = 0.0,
    names: tuple[str, ...] = ("second invariant",),
    neo_hooke: float | None = 20.0,
    converged: bool = True,
    competing: tuple[tuple[str, ...], ...] = (),
    nothing_left: bool = False,
) -> Findings:
    """Few effects by the fields (nothing_left: none, nor relaxation), whose replay with relaxation misses forces held out by `wrong` standard deviations (None: it was not made), beside neo-Hooke with `neo_hooke`, of which 20 are 5 %, and a
    final model with 10."""
    new = check(observations(only_held(wrong or 0.0)))
    additions = (Addition(SecondInvariant(), (0.04,)), Addition(Viscosity(), (0.9,), (1.2,)))
    best = FittedSet(additions[:1], 5.0 if names else -1.0, ErrorsOfReplay(0.05, 0.02), 0.1, {"second invariant": (np.array([0.04]), np.array([0.01]))}, {"second invariant": np.array([False])})  # fmt: skip
    kept, n = (() if nothing_left else additions), 1 if nothing_left else 4
    spread = Spread(Directions.of(np.ones(4), kept, np.ones((4, 1)), 1.0), 0.1 * np.eye(n))
    updated = Updated(spread, *(ErrorsOfReplay(e, 0.02) for e in (0.04, 0.002)), converged, 6, check=new)
    sets = Explanation(names, 0.0, probability=0.7), Explanation(("compressibility",), 0.0, probability=0.02)
    force = NoReplayCheck("no force is known") if wrong is None else updated
    base = NoReplayCheck("no equilibrium") if neo_hooke is None else check(observations(only_held(neo_hooke))).final
    models = (FewModel(names, 0.7, force), *(FewModel(one, 0.2, force) for one in competing))
    few = FewEffects(np.ones(4), ErrorsOfReplay(0.05, 0.06), Alternatives(sets), (best,), models, base)
    return of_nothing(verdict=Verdict.NOT_EXPLAINED, replay_check=check(observations(only_held(10.0))), few=few)


def of_own(own: float, common: float, prior: float = 0.1) -> Findings:
    """Two tests with a gradient in x each."""
    values, deviations = ((0.20, 0.01), (0.18, 0.01)), ((0.02, 0.02), (0.02, 0.02))
    one = OwnEffect(StiffnessGradient(), ("a", "b"), own, common, (prior, prior), values, deviations, 3.0)
    return of_nothing(own=(one,))


def doubtful() -> Findings:
    """The effect that was found, where it is not needed."""
    confirmation = explained().confirmation
    assert confirmation is not None
    doubts = replace(confirmation, doubts=(Doubt.NOT_NEEDED, Doubt.LARGE_FORCE_ERROR))
    return of_explained(named=(), closest=explained().named, confirmation=doubts)


def quiet() -> Findings:
    """Residuals of the base a tenth of the stated noise."""
    fit = nothing().rounds[0].fit
    return of_first_round(fit=replace(fit, unexplained=ChiSquare(0.1 * fit.degrees, fit.degrees)))


def noisy(experiment: Experiment) -> Experiment:
    """Hardly any strain, which scatters by more than it is."""
    noise = np.random.default_rng(0).normal(0.0, 0.01, experiment.displacements.shape)
    return replace(experiment, displacements=1e-4 * experiment.displacements + noise)


def with_patch(name: str, value: Any) -> Findings:
    with mock.patch.object(discovery_findings, name, value):
        return of_nothing()


def no_time() -> Findings:
    """Read from two files, of which one has times."""
    with tempfile.TemporaryDirectory() as place:
        paths = [Path(place, "plain.npz"), Path(place, "timed.npz")]
        sheet().save(paths[0])
        replace(sheet(seed=2), time=np.arange(1.0, 7.0)).save(paths[1])
        return read_experiments(paths, [], None)[2]


STATED = Noise(0.01, 3.0)
OF_DISCOVERY: dict[str, Callable[[], Findings]] = {
    "discovery.no_time": no_time,
    "discovery.unknown_noise": lambda: of_problem(noise_is_known=False),
    "experiment.noise_found": lambda: of_nothing(noise=(NoiseCheck(STATED, 0.012, STATED.scaled(1.2)),)),
    "discovery.overstated_noise": quiet,
    "discovery.no_twin": lambda: of_nothing(without_twin=("plate: a replay needs thin sheets",)),
    "discovery.nothing_held_out": lambda: of_first_round(held=None),
    "discovery.held_out": of_nothing,
    "discovery.round_remark": lambda: of_first_round(refusals=(Refusal("upturn", RefusalReason.HELD_OUT_NOT_BETTER),)),
    "discovery.alternatives": of_weighing,
    "discovery.power": of_weighing,
    "discovery.alike_in_all": lambda: of_own(0.01, 0.99),
    "discovery.of_one_test": lambda: of_own(0.99, 0.01),
    "discovery.own_stand_ins": lambda: of_own(0.99, 0.01, 0.05),
    "discovery.replaced": lambda: replaced("second invariant"),
    "discovery.no_explanation": doubtful,
    "discovery.dominant_effect": lambda: of_explained(
        named=(), closest=explained().named, dominant=DominantEffect("second invariant", 0.95, ("upturn",))
    ),
    "discovery.edges_not_reached": of_strip,
    "discovery.inclusion_at_a_hole": lambda: of_inclusion(0.0, 0.0),
    "discovery.tie": lambda: of_explained(groups={"second invariant": ("second invariant", "upturn")}),
    "discovery.no_thickness": lambda: of_experiment(lambda e: replace(e, thickness=None)),
    "discovery.levels_unknown": lambda: of_nothing(levels=(Level("first", 1.0, 1.0), Level("second", 1.1, 1.11, 0.01))),
    "discovery.moduli_differ": lambda: of_two_tests(1.3),
    "discovery.attenuated": lambda: with_patch("discovery_quality", lambda view: replace(GOOD, attenuation=1.2)),
    "discovery.weak_strain": lambda: of_experiment(noisy),
    "discovery.replayed": lambda: of_nothing(replay_check=check(observations())),
    "discovery.replay_not_made": lambda: of_nothing(replay_check=NoReplayCheck("unmeasured strip: no law has it")),
    "discovery.replay_outside": lambda: of_nothing(replay_check=check(observations(only_held(9.0)))),
    "discovery.replay_worse": lambda: of_explained(replay_check=check(observations(only_held(9.0)), observations())),
    "discovery.replay_levels": lambda: of_nothing(replay_check=check(observations(stiffness=1.07))),
    "discovery.replay_stand_in": lambda: of_nothing(
        replay_check=replace(check(observations()), stand_ins=(True, True))
    ),
    "discovery.replay_beyond": lambda: of_nothing(replay_check=check(observations(), beyond=0.5)),
    "discovery.model_to_use": of_few,
    "discovery.few_effects": of_few,
    "discovery.no_few_effects": lambda: of_few(None),
    "discovery.competing_few_effects": lambda: of_few(competing=(("compressibility",),)),
    "discovery.plane_strain": lambda: with_patch("bulk_modulus", lambda problem, fit: (100.0, 5.0)),
}

# --- prediction, replay, sheets -------------------------------------------------------------------------------

MODEL = neo_hooke()
USELESS = replace(MODEL, fitness=Fitness(Use.NOT, ("forces are missed by 34 %",)), level_is_nominal=True)


def curves(model: Any = MODEL, stretch: float | None = None) -> Findings:
    return predicted_curves.findings(model, predicted_curves.predict(model, stretch))


def of_diagnosis(duration: float | None = None, verdict: str | None = None) -> Findings:
    """Curves of a material that relaxes, found beside an offset of the load cell; with a verdict: with its uncertainty, too."""
    basis, known = SingleBasis(0, 20.0), {effect.name: effect for effect in CATALOGUE}
    additions = (Addition(known["viscoelasticity"], (0.5,), (1.0,)), Addition(known["force offset"], (0.1,), ()))
    model = ExtendedModel(basis, np.ones(basis.n), additions, ((0.1,), (0.1,)), "MPa")
    if verdict is not None:
        model = replace(model, verdict=verdict, uncertainty=ModelUncertainty(np.zeros((basis.n + 3, 1))))
    return curves(DiagnosedLaw(model, duration), 1.2)


def forecast(**changes: Any) -> Findings:
    """Forces of a plate that are met, with what the changes say."""
    exact = {b.name: b.force for b in sheet().loaded}
    return replace(Forecast(sheet(), exact, 0.0, "model"), **changes).findings


def bands(noise_is_known: bool) -> Findings:
    return curves(replace(MODEL, uncertainty=Uncertainty(np.zeros((4, 1)), 1.0, 1.0, noise_is_known)))


def replayed() -> Findings:
    """A replay as far as its findings look at it."""
    effect = SimpleNamespace(field=0.01, force=0.001)
    lens = SimpleNamespace(effect=SimpleNamespace(name="lens distortion"))
    named = SimpleNamespace(remarks=(), left_out=("force offset",), taken_out=(lens,))
    found: Any = SimpleNamespace(
        experiment=sheet(), force_error=0.02, field_error=np.full(sheet().n_increments, 0.1), noise=0.01, mesh_effect=effect, refined=0,
        law=named, lost_record=True, judged=np.array([True, False]), record=SimpleNamespace(error=0.03, time=np.arange(9.0), largest=(0.1, 4.0)),
    )  # fmt: skip
    return replay_report.findings(found)


def of_sheets() -> Iterator[Finding]:
    """The answers of the study, with made-up numbers."""
    error = {"force": 0.05, "field": 0.02}
    yield Finding("measured", SheetCode.SHEET, {
        "name": "A", "verdict": "not explained", "closest": [], "models": ["neo-Hooke", "base"], "before": error, "after": error})  # fmt: skip
    yield Finding("measured", SheetCode.TRANSFERRED, {"name": "B", "variant": "map", "before": error, "after": error})
    yield Finding("measured", SheetCode.CONTROL, {"found": []})


def of_transfer() -> Findings:
    """The same of a transfer."""
    error = {"force": 0.05, "field": 0.02}
    data: dict[TransferCode, dict[str, object]] = {
        TransferCode.TRANSFERRED: {"name": "B", "stiffness": 2.0, "relaxation": None, "before": error, "after": error},
        TransferCode.WORSE: {"name": "B", "model": error, "neo_hooke": error},
        TransferCode.MAP: {"name": "B", "share": 0.2, "low": 0.5, "high": 1.5, "after": error},
        TransferCode.NO_MAP: {"name": "B", "share": -0.1},
        TransferCode.LEFT_OUT: {"effects": ["lens distortion"]},
        TransferCode.OWN_TEST: {"name": "B"},
    }
    return [Finding("transfer", code, data[code]) for code in TransferCode]


def of_decision() -> Findings:
    """The same of what would decide."""
    best = {"rivals": "upturn against lag", "specimen": "PS", "programme": "ramp", "expected": 4.0}
    data: dict[DecideCode, dict[str, Any]] = {
        DecideCode.DECIDES: {**best, "now": 1.0},
        DecideCode.NOTHING_DECIDES: best,
        DecideCode.NOT_SHOWN: {"rivals": "upturn against lag"},
        DecideCode.NOTHING_OPEN: {"unknown": True},
        DecideCode.REFUSED: {"specimens": ["UT (too long)"]},
    }
    return [Finding("decide", code, data[code]) for code in DecideCode]


OF_OTHERS: dict[str, Callable[[], Findings]] = {
    "prediction.fitness": lambda: curves(USELESS),
    "prediction.nominal_level": lambda: curves(USELESS),
    "prediction.no_calibrated_range": lambda: curves(neo_hooke(top=None)),
    "prediction.within_calibrated_range": lambda: curves(stretch=1.2),
    "prediction.leaves_calibrated_range": curves,
    "prediction.leaves_calibrated_mode": lambda: curves(
        replace(MODEL, calibrated_range=MODEL.calibrated_range | {"I1 near equi-biaxial": (3.0, 3.2)})
    ),
    "prediction.bands": lambda: bands(True),
    "prediction.no_bands": curves,
    "prediction.infinitely_slow": of_diagnosis,
    "prediction.at_constant_speed": lambda: of_diagnosis(2.0),
    "prediction.volume_changes_along_curves": lambda: curves(replace(MODEL, bulk_modulus=2.0)),
    "prediction.curves_of_diagnosis": of_diagnosis,
    "prediction.bands_of_diagnosis": lambda: of_diagnosis(verdict="explained"),
    "prediction.effects_left_out_of_curves": of_diagnosis,
    "prediction.force_error": forecast,
    "prediction.one_factor": lambda: forecast(factor=1.5),
    "prediction.outside_range": lambda: forecast(outside=0.1),
    "prediction.bulk_modulus_unused": lambda: forecast(unused_bulk_modulus=100.0),
    "prediction.effects_left_out": lambda: forecast(left_out=("force offset",)),
    "prediction.effects_without_twin": lambda: forecast(without_twin=("unmeasured strip",)),
    **dict.fromkeys(
        (
            f"replay.{name}"
            for name in (
                "force_error",
                "field_error",
                "record_error",
                "mesh_effect",
                "taken_out",
                "left_out",
                "few_free",
            )
        ),
        replayed,
    ),
    **{f"measured.{code}": lambda: list(of_sheets()) for code in SheetCode},
    **{f"transfer.{code}": of_transfer for code in TransferCode},
    **{f"decide.{code}": of_decision for code in DecideCode},
}
CASES = {**OF_HEADLINE, **OF_CALIBRATION, **OF_DISCOVERY, **OF_OTHERS}

# the higher severity, where the numbers ask for it
RAISED: dict[str, Callable[[], Findings]] = {
    "P507": lambda: forecast(forces={b.name: 1e3 * b.force for b in sheet().loaded}),
    "D110": lambda: of_nothing(levels=(Level("first", 1.0, 1.0), Level("second", 0.44, 0.44, 0.01))),
    "D103": lambda: reasons(signals=WEAK, level_is_nominal=True),
    "D111": lambda: of_two_tests(1.6),
    "N207": lambda: reasons(reduced_chi_square=200.0, level_is_nominal=True),
    "N208": lambda: reasons(attenuation=1.6),
    "F301": lambda: reasons(force_error=0.3),
    "F302": lambda: reasons(held_error=0.4),
    "F304": lambda: reasons(relative_deviation=0.6),
    "F307": lambda: fit_findings.findings(review(starts_alike=1)),
    "F321": lambda: reasons(unexplained=True, unconverged=True),
    "F308": lambda: fit_findings.findings(review(neo_hooke_error=0.001, force_error=lambda increments: 0.05)),
    "F309": lambda: fit_findings.findings(
        review(held_out=SimpleNamespace(increments=3, relative_force_error=0.2, chi_square_per_equation=1.1))
    ),
    "F312": lambda: fit_findings.findings(review(classical=laws(law("Yeoh", -50.0)))),
    "N203": lambda: of_nothing(noise=(NoiseCheck(STATED, 0.018, STATED.scaled(1.8)),)),
    "E402": of_weighing,
    "R614": lambda: of_few(20.0),
    "R609": lambda: of_explained(replay_check=check(observations(only_held(9.0)), observations())),
    "P501": lambda: curves(USELESS),
    "P505": lambda: bands(False),
    "P516": lambda: of_diagnosis(verdict="significant, not explained"),
}


def made(macro: str) -> Finding:
    """What the case of a macro makes."""
    template, _, code = macro.partition(".")
    found = [one for one in CASES[macro]() if (one.template, str(one.code)) == (template, code)]
    assert found, f"the case of {macro} does not make it"
    return found[0]


def test_every_code_has_a_case() -> None:
    assert set(CASES) == set(MACROS), "add a case to CASES for each macro of alerts.toml"
    assert set(RAISED) == {code for code, alert in registry().items() if alert.raised is not None}


@pytest.mark.parametrize("macro", MACROS)
def test_every_alert_is_made_by_the_data_that_call_for_it(macro: str) -> None:
    finding = made(macro)
    alert = finding.alert
    assert finding.text and macro in registry()[alert.code].macros
    assert f'<a id="{alert.anchor}"></a>{alert.code} |' in PAGE and alert.page == f"docs/alerts.md#{alert.anchor}"
    record = json.loads(json.dumps(plain(finding.to_dict()), allow_nan=False))
    assert list(record) == ["code", "severity", "text", "means", "do", "page", "data"]
    assert (record["code"], record["text"], record["means"]) == (alert.code, finding.text, alert.means)


@pytest.mark.parametrize("code", list(RAISED))
def test_severity_is_raised_where_the_numbers_ask_for_it(code: str) -> None:
    alert = registry()[code]
    found = {one.alert.severity for one in RAISED[code]() if one.alert.code == code}
    assert alert.raised in found
    usual = {one.alert.severity for macro in alert.macros for one in CASES[macro]() if one.alert.code == code}
    assert alert.severity in usual or code in ("E402", "P501")  # whose cases are the raised ones
    assert alert.severity is not alert.raised


def test_usual_severity_of_those_whose_case_is_raised() -> None:
    doubtful = replace(MODEL, fitness=Fitness(Use.RESERVATIONS, ("forces are missed by 8 %",)))
    assert next(one for one in curves(doubtful) if one.alert.code == "P501").alert.severity is Severity.WARNING
    assert next(one for one in of_weighing(0.01) if one.alert.code == "E402").alert.severity is Severity.NOTE


def test_a_model_that_is_not_to_be_used_has_a_serious_alert_and_a_good_one_has_none() -> None:
    useless = headline(replace(GOOD, force_error=0.5))
    assert useless.verdict is Use.NOT
    assert {one.alert.severity for one in useless.against} == {Severity.SERIOUS}
    assert Severity.SERIOUS not in {one.alert.severity for one in of_nothing()}


def test_limits_that_are_stated_are_those_of_the_headline() -> None:
    limits = {"F301": LIMITS.force_error, "F302": LIMITS.held_error, "F304": LIMITS.deviation}
    for code, (reservation, useless) in limits.items():
        alert = registry()[code]
        assert percent(reservation) in alert.means and percent(useless) in alert.when
    assert f"above {LIMITS.attenuation[1]:g}" in registry()["N208"].when
    assert f"above {LIMITS.nominal_chi_square[1]:g}" in registry()["N207"].when
    assert LIMITS.strain == 3 and "three times" in registry()["D103"].means


def test_a_factor_that_no_noise_can_make_is_not_told_as_one() -> None:
    """As where forces and displacements are not of one test."""
    (told,) = reasons(attenuation=6e8)
    assert "more than 100 times" in told.text and "000" not in told.text
    assert "by a factor of 1.60" in reasons(attenuation=1.6)[0].text


@pytest.mark.parametrize(("ratio", "blamed"), [(3.5, True), (24.0, False)])
def test_noise_is_blamed_for_no_more_than_it_can_take_away(ratio: float, blamed: bool) -> None:
    """Regression dilution is one over the square of signal to noise: 8 % at 3.5, 0.2 % at 24."""
    (told,) = reasons(attenuation=1.6, signals=(StrainSignal(0.3, 0.3 / ratio, 0),))
    assert ("noise in the strain" in told.text) is blamed
    assert ("what the model misses" in told.text) is not blamed


# --- the registry ---------------------------------------------------------------------------------------------


def names_of_macros() -> dict[str, set[str]]:
    """Values of every subclass of `Macro` in the source of the studies, by class and file."""
    found = {}
    for path in (ROOT / "studies").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef) and any(isinstance(b, ast.Name) and b.id == "Macro" for b in node.bases):
                values = {ast.literal_eval(one.value) for one in node.body if isinstance(one, ast.Assign)}
                found[f"{path.name}: {node.name}"] = values
    return found


def test_every_macro_of_a_finding_has_a_code_and_no_code_is_idle() -> None:
    registered = {macro.partition(".")[2] for macro in MACROS}
    named = names_of_macros()
    assert len(named) > 8
    assert not {place: values - registered for place, values in named.items() if values - registered}
    assert registered == set().union(*named.values())


def test_every_anchor_of_the_page_is_there_once() -> None:
    for alert in registry().values():
        assert PAGE.count(f'id="{alert.anchor}"') == 1
    assert PAGE.count("<a id=") == len(registry())


class Unknown(Macro):
    """A macro of a template that has no code."""

    TABLE = "force_table"


def test_a_finding_without_a_code_is_refused() -> None:
    with pytest.raises(AlertError, match=r"calibration\.force_table"):
        Finding("calibration", Unknown.TABLE)
    with pytest.raises(AlertError, match="without a code"):
        alert_of("prediction", "plane_strain")  # of another template
    with pytest.raises(AlertError, match="P503: is raised"):
        Finding("prediction", predicted_curves.Extent.WITHIN, {"mode": "uniaxial", "end": 2.0}, raised=True)


ENTRY = 'macros = ["prediction.bands"]\nseverity = "note"\nmeans = "This."\ndo = "That."\n'


def registered(*entries: str) -> str:
    return '[subjects]\nP = "Prediction"\n' + "".join(entries)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (registered("[P501]\n", ENTRY, "[P501]\n", ENTRY), "cannot be read"),
        (registered("[P501]\n", ENTRY, "[P502]\n", ENTRY), "belongs to P501 and P502"),
        (registered("[Q501]\n", ENTRY), "Q501 is no code"),
        (registered("[P5]\n", ENTRY), "P5 is no code"),
        (registered("[P501]\n", ENTRY.replace("bands", "band")), "no macro prediction.band"),
        (registered("[P501]\n", ENTRY.replace("prediction", "forecast")), "no macro forecast.bands"),
        (registered("[P501]\n", ENTRY.replace("note", "fatal")), "'fatal' is none"),
        (registered("[P501]\n", ENTRY.replace("That.", " ")), "must not be empty"),
        (registered("[P501]\n", ENTRY, 'page = "x"\n'), "P501 needs"),
        (registered("[P501]\n", ENTRY, 'raised = "warning"\n'), "together with when"),
        (registered("[P501]\n", ENTRY, 'raised = "note"\nwhen = "ever"\n'), "more serious than note"),
    ],
)
def test_a_registry_that_is_wrong_is_named(text: str, message: str) -> None:
    assert list(read(registered("[P501]\n", ENTRY))) == ["P501"]
    with pytest.raises(AlertError, match=message):
        read(text)


# --- how they are shown ---------------------------------------------------------------------------------------


def some() -> list[Finding]:
    return [
        made("calibration.plane_strain"),
        made("headline.forces_missed"),
        *RAISED["F302"](),
        made("calibration.forces"),
    ]


def test_lines_are_sorted_by_severity_and_code_and_name_both() -> None:
    lines = list(alert_lines(some()))
    assert [line.split(":")[0] for line in lines] == ["- F302 serious", "- F301 warning", "- D107", "- F308"]
    assert lines[0] == f"- F302 serious: {RAISED['F302']()[0].text}"
    assert [one["code"] for one in alert_records(some())] == ["F302", "F301", "D107", "F308"]


def test_the_table_of_a_report_leads_to_what_a_code_means() -> None:
    html = add_alerts(Report("A report"), [*some(), *some()]).html()
    for name in COLUMNS:
        assert f">{name}</button>" in html
    for finding in in_order(some()):
        alert = finding.alert
        assert f'<a href="#{alert.anchor}" title="{alert.page}">{alert.code}</a>' in html
        assert html.count(f'id="{alert.anchor}"') == 1 and alert.means in html
    assert "Alerts" not in add_alerts(Report("A report"), []).html()


def test_a_base_that_followed_the_noise_is_told() -> None:
    for one_modulus in (False, True):
        (told,) = (one.text for one in of_experiment(noisy, one_modulus=one_modulus) if one.alert.code == "D103")
        assert ("the base is one modulus" in told) is one_modulus


def test_noise_that_pictures_have_in_common_is_told_with_its_parts():
    used = Noise(0.006, 3.0, pattern_std=0.008)
    told = noise_found("sheet", NoiseCheck(STATED, used.total_std, used)).text
    assert "in common" in told
    assert "8 um that stay with the pattern" in told
    assert "6 um that are new in every picture" in told
    drift = Noise(0.006, 3.0, correlation_time=12.0)
    told = noise_found("sheet", NoiseCheck(STATED, drift.total_std, drift)).text
    assert (
        "those before them. What is new in a picture goes on in the next ones for 12 s" in told
        and "pattern" not in told
    )
    unstated = noise_found("sheet", NoiseCheck(None, 0.01, replace(used, correlation_time=3.0)), "increments").text
    assert "6 um that last for a time;" in unstated and "for 3 increments" in unstated
    kept = noise_found("sheet", NoiseCheck(used, 2 * used.total_std, used.scaled(2.0))).text
    assert "2 times as much" in kept and "in common" not in kept


@pytest.mark.parametrize(
    ("reason", "replayed", "told"),
    [
        (Reason.FORCES_NOT_PREDICTED, False, True),
        (Reason.WEAK_STRAIN, True, False),
        (Reason.ATTENUATED, True, True),  # a replay gives the model of few effects a level of its own
        (Reason.ATTENUATED, False, False),
    ],
)
def test_few_effects_are_told_where_only_the_final_model_fails(
    reason: Reason, replayed: bool, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    against = SimpleNamespace(verdict=Use.NOT, against=(SimpleNamespace(code=reason),), reasons=())
    for module in (discovery_findings, discovery_quality):
        monkeypatch.setattr(module, "discovery_headline", lambda view: against)
    codes = {one.alert.code for one in of_few(neo_hooke=20.0 if replayed else None)}
    assert ("R619" in codes) is told
    assert "E402" not in codes


def test_few_effects_are_offered_where_their_replay_is_the_best() -> None:
    """It misses none of the forces held out, or 5 %, beside neo-Hooke with 5 % and a final model with half of that."""
    told = {one.alert.code: one for one in of_few()}
    said = told["R619"].text
    assert (
        "second invariant (probability 70 %), 0.06 -> 0.02 mm in what was fitted" in said
        and "compressibility" not in said
    )
    assert "viscoelasticity g = 0.90 +- 0.20, tau = 1.20 +- 0.20 s" in said and "forces by 0 %" in said
    assert told["R614"].text == "To predict with: model_few_effects.json." and "R620" not in told
    worse = {one.alert.code: one.text for one in of_few(20.0)}
    assert worse["R614"].startswith("No model is the one to predict with")
    assert "which would still change" not in said and "which would still change" in next(
        one.text for one in of_few(converged=False) if one.alert.code == "R619"
    )
    assert next(one.text for one in of_few(names=(), neo_hooke=0.0, nothing_left=True) if one.alert.code == "R614") == (
        "To predict with: model_neo_hooke.json."  # the same, by its own name
    )
    none = {one.alert.code: one.text for one in of_few(names=())}
    assert "none (probability 70 %); neo-Hooke alone leaves 0.06 mm" in none["R619"]
    refused = {one.alert.code: one.text for one in of_few(None)}
    assert "R621" not in told
    assert "no force is known" in refused["R620"] and "model_few_effects" not in refused["R614"] + refused["R619"]


def test_few_effects_that_compete_are_told_with_what_they_predict() -> None:
    """Each by its own file, and the average of all; neo-Hooke alone may be one of them."""
    told = {one.alert.code: one.text for one in of_few(4.0, competing=(("compressibility", "lens distortion"), ()))}
    said = told["R621"]
    assert "compressibility and lens distortion (probability 20 %), with what the forces add (viscoelasticity" in said
    assert "model_few_effects_2.json; none (probability 20 %)" in said and said.count("forces by 1 %") == 3
    assert "Averaged by their probabilities, they miss forces by 1 % and" in said


def test_a_model_that_replays_worse_than_neo_hooke_is_not_offered() -> None:
    """Neo-Hooke misses none of the forces that were held out, few effects 1 %, the final model 2.6 %."""
    told = next(one for one in of_few(4.0, neo_hooke=0.0) if one.alert.code == "R614")
    assert told.text.startswith("To predict with: model_neo_hooke.json.")
    better = next(one.text for one in of_few(4.0) if one.alert.code == "R614")
    assert better.startswith("To predict with: model_few_effects.json.")


def test_a_law_that_misses_the_forces_by_more_is_not_recommended():
    network = SimpleNamespace(name="network", fit=None, numbers=8, criterion=0.0, chi_square=0.0)
    known = {"classical": Comparison(100, 1.0, network, (law("Yeoh", -50.0),))}
    (worse,) = (one.text for one in fit_findings.findings(review(**known)) if one.alert.code == "F312")
    assert "misses the forces by 5 %, the network by 1 %" in worse
    assert "take that law" not in worse
    (better,) = (
        one.text
        for one in fit_findings.findings(review(**known, force_error=lambda some: 0.06))
        if one.alert.code == "F312"
    )
    assert "take that law" in better


def test_forces_of_grips_that_differ_are_told():
    """A quarter of the largest force is left over; by two per cent nothing is said, nor of a single grip."""
    told = made("calibration.grips_differ").text
    assert "25 % of the largest is left over (measured: 0 %)" in told and "left 2 N, right 1.5 N" in told
    across = two_grips(1.5)
    across["measured"] = {name: force + [0.0, np.nan] for name, force in across["measured"].items()}
    told_of = [one.text for one in fit_findings.findings(review(**across)) if one.alert.code == "F319"]
    assert told_of == [told]  # forces across the pull were not recorded
    one_cell = two_grips(1.5)
    one_cell["measured"]["left"] = np.full((5, 2), np.nan)
    for quiet in (two_grips(1.96), {}, one_cell):
        assert "F319" not in {one.alert.code for one in fit_findings.findings(review(**quiet))}


def test_an_inclusion_in_the_material_is_no_hole():
    assert "E414" not in {one.alert.code for one in of_inclusion(0.4, 0.4)}


@pytest.mark.parametrize(("verdict", "is_found"), [(Verdict.NOT_EXPLAINED, False), (Verdict.EXPLAINED, True)])
def test_what_all_explanations_have_is_a_finding_of_an_explained_test_alone(verdict, is_found):
    told = next(one for one in of_weighing(0.01, 0.99, verdict=verdict) if one.alert.code == "E402")
    assert ("Present with more than 95 %" in told.text) is is_found
    assert ("no finding" in told.text) is not is_found


def test_half_of_a_sheet_is_no_rim():
    assert "E414" not in {one.alert.code for one in of_inclusion(0.6, 0.0, 0.6)}
    assert "E414" in {one.alert.code for one in of_inclusion(0.6, 0.0, 0.12)}


def test_moduli_of_tests_are_compared():
    """Those of the fitted forces, by least squares: in proportion to the forces, and nothing is said of tests that are nearly alike."""
    (told,) = (one for one in of_two_tests(1.3) if one.alert.code == "D111")
    first, second = told.data["moduli"].values()
    assert second / first == pytest.approx(1.3, rel=1e-6) and 0.2 < first < 0.4
    assert "D111" not in {one.alert.code for one in of_two_tests(1.2)}


def test_a_model_as_stiff_as_a_metal_is_told_its_units():
    told = made("calibration.not_soft").text
    assert "is above that of any soft material (200 MPa)" in told and "forces are in N" in told
    below = replace(neo_hooke(), parameters=1e-6 * neo_hooke().parameters)
    assert "is below that of any soft material (0.001 MPa)" in fit_findings.stiffness(below)[0].text
    assert fit_findings.stiffness(neo_hooke()) == []


@pytest.mark.parametrize(
    ("found", "deviations", "said"),
    [
        ({"mu": 0.5, "alpha": 2.0}, (0.1, 0.1), "mu = 0.50 +- 0.10 MPa, alpha = 2.00 +- 0.10"),
        ({"mu": 0.5, "alpha": 2.0}, (0.1, 97075.0), "mu = 0.50 +- 0.10 MPa, alpha = 2 (alpha not identified)"),
        ({"mu1": 0.4, "mu2": 0.1}, (np.inf,) * 2, "mu1 = 0.4 MPa, mu2 = 0.1 MPa (mu1 and mu2 not identified)"),
    ],
)
def test_parameters_that_the_data_do_not_identify_are_said(found, deviations, said):
    """Whose deviation is far larger than themselves."""
    parameters = tuple(SimpleNamespace(name=name, modulus=name.startswith("mu")) for name in found)
    fit: Any = SimpleNamespace(law=SimpleNamespace(parameters=parameters), values=found, deviations=lambda scale: np.array(deviations))  # fmt: skip
    assert classical_table.values(fit, "MPa", 1.0).endswith(said)


@pytest.mark.parametrize(("relative", "said"), [(0.6, "known to 60 % only"), (6.4e14, "not known")])
def test_a_modulus_that_is_less_certain_than_itself_is_not_known(relative: float, said: str) -> None:
    """Of forces of the wrong sign a deviation of 6.4e16 % was told."""
    (found,) = reasons(relative_deviation=relative)
    assert said in found.text
