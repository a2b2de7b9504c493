"""The report of a discovery: what it says of effects that are there, that are not, and that cannot be seen."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from discoveries import C01, explained, held, nothing, sheet, view
from discovery_stand_in import StandInManifest, StandInModel
from made_up_replay import HELD, INCREMENTS, check, observations, only_held
from matplotlib.figure import Figure

from calibrate.diagnosis.effect_fit import refit
from calibrate.diagnosis.evidence.explanations import Alternatives, Explanation, Power, Weighing
from calibrate.diagnosis.evidence.explanations import Finding as PowerFinding
from calibrate.diagnosis.misfit import misfit
from calibrate.diagnosis.model_weights import noise_of
from calibrate.diagnosis.replayed.band import ALTERNATIVES, BEYOND, Band
from calibrate.diagnosis.replayed.checked_replay import NoReplayCheck
from calibrate.diagnosis.replayed.few_effects import FewEffects, FewModel, FittedSet
from calibrate.diagnosis.replayed.observations import ReplayErrors as ErrorsOfReplay
from calibrate.diagnosis.replayed.parameter_spread import Directions, Spread
from calibrate.diagnosis.replayed.replay_rule import Judgement
from calibrate.diagnosis.replayed.updating import Updated
from calibrate.diagnosis.residual_tests import ChiSquare
from calibrate.diagnosis.score_tests import Score, Status
from calibrate.diagnosis.selection import Discovery, Verdict
from calibrate.diagnosis.selection.rounds import DominantEffect, Doubt, Refusal, RefusalReason, Unexpected
from calibrate.diagnosis.selection.thresholds import DEFAULT
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.effects.second_invariant import SecondInvariant
from calibrate.equations.weights import weights_of
from calibrate.models.extended_model import ExtendedModel
from calibrate.models.parameter_covariance import Z95
from studies.output.alerts import Severity
from studies.reports.alert_table import in_order
from studies.reports.discovery import figures, report
from studies.reports.discovery.candidate_outcome import Outcome, outcome, outcome_words, untested_words
from studies.reports.discovery.discovery_findings import DiscoveryCode, remarks
from studies.reports.discovery.model_files import unexplained
from studies.reports.discovery.records import amplitude_records, candidate_record, content, model_amplitude_records
from studies.reports.discovery.replays.replay_section import ReplayCode, replay_table
from studies.reports.discovery.replays.replayed_forces import band_fields, band_rows, course_rows, force_courses
from studies.reports.discovery.replays.replayed_models import (
    average_of_few,
    recommendation,
    replayed_models,
    to_predict_with,
    updated_bands,
)
from studies.reports.discovery.statement import Statement, use_of_models, verdict
from studies.reports.discovery.tables import candidate_table, catalogue_table, model_table
from studies.reports.discovery.view import (
    decorrelated,
    deviations,
    forces,
    held_increments,
    nodal,
    stiffness_of_triangles,
)
from studies.reports.headline import Reason

BY_NAME = {effect.name: effect for effect in CATALOGUE}


def row(name: str, number: int = 0):
    now = explained().rounds[number]
    return next(c for c in now.candidates if c.name == name), now


def without_noise(found: Discovery) -> Discovery:
    return replace(found, problem=replace(found.problem, noise_is_known=False))


def test_an_effect_that_was_measured_says_by_what() -> None:
    candidate, now = row("stiffness gradient")
    for effect, words in (
        ("force offset", "forces count from that at the reference picture"),
        ("out-of-plane motion", "two cameras"),
    ):
        score = Score(BY_NAME[effect], Status.EXCLUDED)
        assert words in outcome_words(replace(candidate, score=score), now)
        assert words in untested_words(score)


# --- numbers --------------------------------------------------------------------------------------------------


def test_residuals_of_the_true_model_stay_within_noise_and_discretisation():
    """The data have no discretisation error, for which the covariance leaves room: below one, not at it."""
    part = explained().problem.parts[0]
    z, before = decorrelated(explained().problem, part, [explained().final, explained().base])
    assert np.isfinite(z).all()
    assert np.mean(z**2) < 1
    assert np.mean(before**2) > 4 * np.mean(z**2)


def test_sum_of_squares_is_the_chi_square_where_nothing_is_common_to_increments():
    """Whitening by a symmetric root or by Cholesky's: the same size."""
    problem = explained().problem
    part = problem.parts[0]
    noise = noise_of(part, problem.weights_c, problem.amplifying)
    train, held_out = (weights_of(noise, weights.rows) for weights in (part.train, part.held))
    plain = replace(part, common=None, train=train, held=held_out)
    fit = explained().base
    (z,) = decorrelated(explained().problem, plain, [fit])
    r = part.own_residual(fit.c)
    assert (z[~held()] ** 2).sum() == pytest.approx((plain.train(r) ** 2).sum(), rel=1e-5)
    assert (z[held()] ** 2).sum() == pytest.approx((plain.held(r) ** 2).sum(), rel=1e-5)


def test_deviations_hold_the_noise_of_the_load_cells():
    part = explained().problem.parts[0]
    n = part.system.fields.n_fields
    measured = np.abs(part.system.loads[:, [n - 1]])
    assert (deviations(part)[:, [n - 1]] > 1e-3 * measured).all()


def test_map_of_equal_residuals_is_flat():
    part = explained().problem.parts[0]
    values = nodal(part, np.full(part.system.loads.shape, 2.0))
    covered = np.asarray(part.system.fields.values.sum(axis=1)).ravel() > 0
    assert values[:, covered] == pytest.approx(2.0)


def test_forces_are_the_load_cells_and_what_the_model_would_read():
    part = explained().problem.parts[0]
    for boundary in sheet().loaded:
        measured, predicted, spread = forces(part, explained().final)[boundary.name]
        assert measured == pytest.approx(boundary.force)
        assert (np.abs(predicted - measured) < 4 * spread).all()


def test_increments_held_out_are_those_of_the_rule():
    assert (held_increments(explained().problem.parts[0]) == held()).all()


def test_intervals_are_two_deviations_wide_and_hold_the_truth():
    (amplitude,) = amplitude_records(row("second invariant")[0], "MPa")
    assert amplitude.low_95 < C01 < amplitude.high_95
    assert amplitude.high_95 - amplitude.fitted == pytest.approx(Z95 * amplitude.fitted_deviation)
    assert (amplitude.unit, amplitude.lowest, amplitude.highest) == ("MPa", 0.0, None)
    ((name, of_model),) = model_amplitude_records(explained().final, "MPa", 1.02)
    assert name == "second invariant" and np.isnan(of_model.tested)
    assert of_model.fitted == pytest.approx(1.02 * explained().final.additions[0].amplitudes[0])
    assert of_model.fitted_deviation == pytest.approx(1.02 * explained().final.deviations[0][0])


def test_predicted_improvement_is_achieved():
    """The score test is a linearisation about no effect; here the effect explains all but noise. In the weights of the round both times."""
    candidate, now = row("second invariant")
    found = candidate_record(candidate, now, "MPa")
    assert 0.5 < found.predicted_improvement < 1
    fit = refit(explained().start, now.fit.c, (candidate.addition,))
    achieved = (now.fit.free_loss - fit.free_loss) / now.fit.free_loss
    assert achieved == pytest.approx(found.predicted_improvement, abs=0.2)
    assert found.held_out_after["force_error"] < found.held_out_before["force_error"]


def test_everything_can_be_written_as_json():
    everything = content(view(explained()))
    again = json.loads(json.dumps(everything))
    assert [len(now["candidates"]) for now in again["rounds"]] == [5, 4]
    assert again["experiments"][0]["held_out_increments"] == (np.flatnonzero(held()) + 1).tolist()


# --- verdict --------------------------------------------------------------------------------------------------


def test_verdict_names_effect_amplitude_and_errors():
    said = Statement.of(view(explained()))
    assert said.verdict is Verdict.EXPLAINED
    ((name, (amplitude,), like),) = ((n.name, n.values, n.like) for n in said.named)
    assert (name, like, said.decided_by) == ("second invariant", (), ())
    assert amplitude.startswith("c01 = 0.0") and amplitude.endswith("MPa")
    assert said.errors.held_out and said.errors.force_after < said.errors.force_before
    assert f"({amplitude})" in verdict(view(explained()))


def test_verdict_of_a_tie_names_what_would_decide():
    tied = view(replace(explained(), groups={"second invariant": ("second invariant", "stiffness gradient")}))
    said = Statement.of(tied)
    assert said.named[0].like == ("stiffness gradient",)
    assert len(said.decided_by) == 2 and all(test in verdict(tied) for test in said.decided_by)


def test_a_tie_says_how_probable_each_is():
    other = "stiffness gradient"
    found = [Explanation(("second invariant",), 0.0), Explanation((other,), 1.0)]
    weighed = replace(explained().weighing, alternatives=Alternatives.of(found), fitted=True)
    tied = view(replace(explained(), groups={"second invariant": ("second invariant", other)}, weighing=weighed))
    assert f"cannot be told from: {other} (73 %)" in verdict(tied)
    (said,) = (one.text for one in remarks(tied) if one.code is DiscoveryCode.TIE)
    assert "(probability 27 %)" in said and f"More probable than what the model has is {other}." in said
    (weights,) = (one.text for one in remarks(tied) if one.code is DiscoveryCode.ALTERNATIVES)
    assert f"Present with more than 95 % probability: {other} or second invariant" in weights


def test_nothing_significant():
    said = Statement.of(view(nothing()))
    assert said.verdict is Verdict.NOTHING_SIGNIFICANT
    assert not said.best.significant and not said.residual.more_than_noise


def test_not_explained_says_how_much_is_left():
    found = replace(explained(), verdict=Verdict.NOT_EXPLAINED, named=(), closest=("second invariant",))
    assert Statement.of(view(found)).closest[0].name == "second invariant"
    assert "second invariant" in verdict(view(found))
    alone = replace(nothing(), verdict=Verdict.NOT_EXPLAINED)
    assert Statement.of(view(alone)).may_be_false_alarm
    loud = replace(alone.rounds[-1], predicted=ChiSquare(100.0, 10))
    loud = view(replace(alone, rounds=(*alone.rounds[:-1], loud)))
    assert not Statement.of(loud).may_be_false_alarm and Statement.of(loud).residual.more_than_noise


def test_an_effect_without_a_name_is_told_with_its_probability():
    """Whether it is too small to be named or not probable enough; with --quick there is none."""
    found = replace(explained(), named=(), closest=("second invariant",), weighing=None)
    assert "second invariant (c01" in verdict(view(found)) and "probability" not in verdict(view(found))
    known = [Explanation(("second invariant",), 0.0, False), Explanation((), -0.85, False)]
    weighed = replace(found, weighing=Weighing(Alternatives.of(known), {}, (), True))
    assert "MPa; probability 70 %)" in verdict(view(weighed))


def test_the_dominant_effect_of_what_is_not_explained_is_said_with_those_that_leave_little_more():
    found = replace(explained(), verdict=Verdict.NOT_EXPLAINED, named=(), closest=("second invariant",))
    traced = replace(found, dominant=DominantEffect("second invariant", 0.934, ("upturn",)))
    said = " ".join(verdict(view(traced)).split())
    assert (
        "significant, not explained; dominant effect: second invariant (alone takes 93 % of the misfit beyond noise; upturn little less)"
        in said
    )
    assert "dominant" not in verdict(view(found))
    assert content(view(traced))["dominant"] == {"effect": "second invariant", "share": 0.934, "like": ("upturn",)}
    assert content(view(found))["dominant"] is None


def test_a_useless_model_is_said_first_and_no_test_of_an_effect_is_believed():
    last = explained().rounds[-1]
    useless = view(
        replace(explained(), rounds=(explained().rounds[0], replace(last, train=replace(last.train, force=0.54))))
    )
    said = verdict(useless)
    assert said.startswith("do not use") and "54 %" in said and "second invariant" not in said
    assert not any("Round" in one.text for one in remarks(useless))
    doubtful = view(
        replace(explained(), rounds=(explained().rounds[0], replace(last, train=replace(last.train, force=0.08))))
    )
    assert verdict(doubtful).startswith("explained")
    first, second = use_of_models(doubtful)
    assert first.startswith("To predict with: model.json") and second.startswith("model.json: usable with reservations")
    worst = {one.alert.severity for one in remarks(useless)}, {one.alert.severity for one in remarks(doubtful)}
    assert Severity.SERIOUS in worst[0] and Severity.SERIOUS not in worst[1]
    assert remarks(doubtful)[0].code is Reason.FORCES_MISSED and not use_of_models(useless)


def test_a_fit_that_has_not_converged_is_said():
    now = explained().rounds[-1]
    late = replace(explained(), rounds=(explained().rounds[0], replace(now, fit=replace(now.fit, last_step=3.2))))
    assert Statement.of(view(late)).last_step == 3.2 and "3.2" in verdict(view(late))


def test_unknown_noise_gives_no_p_value():
    found = view(without_noise(nothing()))
    assert not Statement.of(found).residual.noise_is_known and "p = " not in verdict(found).split(";")[-1]
    columns, rows = model_table(found)
    assert rows[0][columns.index("p")] is None
    assert len(remarks(found)) == len(remarks(view(nothing()))) + 1


def test_nothing_held_out_is_said():
    rounds = tuple(replace(now, held=None) for now in explained().rounds)
    found = replace(view(replace(explained(), rounds=rounds)), hold_out="nothing")
    assert verdict(found).startswith("explained, but not confirmed, as nothing was held out: ")
    assert verdict(view(explained())).startswith("explained: ")
    assert not Statement.of(found).errors.held_out
    assert any("--hold-out" in one.text for one in remarks(found))


def test_table_has_a_row_for_every_candidate():
    columns, rows = candidate_table(explained().rounds[0], view(explained()))
    by_name = {r[0]: dict(zip(columns, r, strict=True)) for r in rows}
    assert len(by_name) == 5
    assert "needs time" in by_name["viscoelasticity"]["outcome"]
    assert "unloading" in by_name["Mullins softening"]["outcome"]
    assert by_name["force gain"]["score"] is None
    before = next(name for name in columns if name.startswith("force error, held out"))
    assert by_name["second invariant"][before] < 100 * explained().rounds[0].held.to_dict()["force_error"]
    assert by_name["stiffness gradient"][before] is None  # it is not significant, and was not fitted
    assert by_name["stiffness gradient"]["amplitude, 95 % interval"].startswith("gx = ")  # of the score test


def test_second_table_shows_what_is_in_the_model():
    columns, rows = candidate_table(explained().rounds[1], view(explained()))
    first = dict(zip(columns, rows[0], strict=True))
    assert (first["effect"], first["outcome"]) == ("second invariant", "in the model")
    assert first["amplitude, 95 % interval"].startswith("c01 = 0.0")
    assert first["amplitude, 95 % interval"].endswith("MPa")


def test_outcomes_in_the_table_are_those_of_the_thresholds_of_the_diagnosis():
    """A stricter search finds nothing significant; a looser limit of likeness tells fewer effects apart."""
    first = explained().rounds[0]
    alike = tuple(replace(c, like=(("stiffness gradient", 0.8),)) for c in first.candidates)
    now = replace(first, added=None, group=(), candidates=alike)
    said = {}
    for thresholds in (DEFAULT, replace(DEFAULT, significance=0.0, collinear=0.7)):
        columns, rows = candidate_table(now, view(replace(explained(), thresholds=thresholds)))
        said[thresholds] = dict(zip(columns, next(r for r in rows if r[0] == "second invariant"), strict=True))
    usual, other = said.values()
    assert usual["outcome"].startswith("significant") and usual["cannot be told from"] is None
    assert (other["outcome"], other["cannot be told from"]) == ("not significant", "stiffness gradient")


def test_an_effect_that_is_a_candidate_only_beside_another_is_in_catalogue_and_scores():
    """The first round does not know it; of every effect without a score the figure says why."""
    first, last = explained().rounds
    second = BY_NAME["second relaxation time"]
    (tested,) = (c for c in first.candidates if c.name == "second invariant")
    later = replace(tested, score=replace(tested.score, effect=second))
    absorbed = (
        replace(c, score=Score(c.score.effect, Status.ABSORBED)) if c.name == "stiffness gradient" else c
        for c in last.candidates
    )
    found = view(replace(explained(), rounds=(first, replace(last, candidates=(*absorbed, later)))))
    assert [r[2].startswith(second.formula) for r in catalogue_table(found)[1] if r[0] == second.name] == [True]
    base, final = figures.scores(found).axes
    places = [one.get_text() for one in base.get_yticklabels()]
    assert set(places) == {"second invariant", "stiffness gradient", second.name}
    texts = [{places[round(t.get_position()[1])]: t.get_text() for t in ax.texts if t.get_transform() == ax.get_yaxis_transform()} for ax in (base, final)]  # fmt: skip
    assert texts[0] == {second.name: "a candidate only beside viscoelasticity"}
    assert texts[1] == {"second invariant": "in the model", "stiffness gradient": "the base model can do the same"}


def test_noise_that_is_overstated_is_remarked():
    found = nothing()
    first = found.rounds[0]
    small = replace(first.fit, unexplained=ChiSquare(0.1 * first.fit.degrees, first.fit.degrees))
    quiet = replace(found, rounds=(replace(first, fit=small), *found.rounds[1:]))
    assert len(remarks(view(quiet))) == len(remarks(view(found))) + 1


def test_outcomes_of_candidates():
    first, now = row("stiffness gradient")
    strong = replace(first, score=replace(first.score, adjusted=1e-4))
    reason = RefusalReason.HELD_OUT_NOT_BETTER
    refused = replace(now, added=None, refusals=(Refusal("stiffness gradient", reason),))
    negative = replace(strong, score=replace(strong.score, admissible=False))
    assert outcome(first, now) is Outcome.NOT_SIGNIFICANT
    assert outcome(row("second invariant")[0], now) is Outcome.ADDED
    assert outcome(row("force gain")[0], now) is Outcome.NOT_TESTED
    assert outcome(strong, refused) is Outcome.REFUSED
    assert outcome(strong, replace(now, added=None)) is Outcome.NOT_TRIED
    assert outcome(replace(strong, fit=row("second invariant")[0].fit), now) is Outcome.NOT_THE_BEST
    assert outcome(strong, now) is Outcome.NOT_REFITTED
    assert outcome(negative, now) is Outcome.NOT_ADMISSIBLE


@pytest.mark.parametrize("reason", list(RefusalReason))
def test_every_refusal_has_words(reason):
    now = replace(explained().rounds[0], refusals=(Refusal("lens distortion", reason),))
    found = replace(explained(), rounds=(now, *explained().rounds[1:]))
    assert any("lens distortion" in one.text for one in remarks(view(found)))


@pytest.mark.parametrize("doubt", list(Doubt))
def test_every_doubt_has_words_in_the_verdict_and_in_its_alert(doubt):
    """What lies beyond its prior is named, and how to change that."""
    far = doubt is Doubt.BEYOND_PRIOR
    found = explained().doubted(
        doubt, beyond_prior=(Unexpected("second invariant", "c01", 5.23, 0.02, "modulus", 0.034),) if far else ()
    )
    said = verdict(view(found)), next(one.text for one in remarks(view(found)) if one.code.endswith("no_explanation"))
    for text in said:
        assert "no explanation" in text
        said_how_far = (
            "c01 of second invariant is 5.2 standard deviations of its prior (std 0.02 of modulus; from 0.034 on"
        )
        assert (said_how_far in " ".join(text.split())) == far
    assert content(view(found))["confirmation"]["doubts"][-1] == doubt


# --- figures and files ----------------------------------------------------------------------------------------


def test_what_varies_over_the_sheet_has_a_picture_and_a_table(tmp_path):
    """An inclusion beside a gradient: their product, in each triangle. Without either there is none."""
    part, shape = explained().problem.parts[0], (0.0, 0.2, 0.15, 0.0, 0.0, 0.0, 0.0)
    additions = (
        Addition(BY_NAME["inclusion"], (0.5,), shape), Addition(BY_NAME["stiffness gradient"], (0.2, 0.0)), *explained().final.additions
    )  # fmt: skip
    last = explained().rounds[-1]
    found = view(
        replace(
            explained(), rounds=(*explained().rounds[:-1], replace(last, fit=replace(last.fit, additions=additions)))
        )
    )
    assert figures.stiffness(view(explained()), part) is None
    drawn = figures.stiffness(found, part)
    assert drawn is not None
    data, values = part.chain.data, stiffness_of_triangles(part, found.discovery.final)
    apart = (np.asarray(data.centroids) - np.asarray(data.centre)) / float(data.size)
    far = np.hypot(apart[:, 0], apart[:, 1] - 0.2) > 0.25
    assert values[far] == pytest.approx(1 + 0.2 * apart[far, 0], abs=0.01)
    within = np.hypot(apart[:, 0], apart[:, 1] - 0.2) < 0.08
    assert within.any()
    assert values[within] == pytest.approx(1.5 * (1 + 0.2 * apart[within, 0]), abs=0.02)
    (path,) = report._stiffness(tmp_path, found)
    table = np.loadtxt(path, delimiter=",", skiprows=2, usecols=(1, 2, 3))
    assert table[:, 2] == pytest.approx(values)
    assert report._stiffness(tmp_path, view(explained())) == []


def test_figures_show_both_models():
    part = explained().problem.parts[0]
    found = view(explained())
    assert len(figures.residual_map(found, part).axes) == 2 * 3 + 1
    history = figures.force_history(found, part)
    assert {line.get_label() for line in history.axes[0].lines} == {"measured", "base model", "final model"}
    assert len(figures.scores(found).axes) == 2
    assert isinstance(figures.intervals(found), Figure)
    assert figures.intervals(view(nothing())) is None
    assert figures.replayed_forces(found) is None


def test_replayed_forces_of_every_model_are_drawn_beside_the_measured_ones():
    """A base that misses forces held out, and a final model that meets all."""
    right = observations()
    wrong = replace(right, replayed=right.replayed + 0.02 * only_held(1.0))
    found = replace(explained(), replay_check=check(right, wrong))
    figure = figures.replayed_forces(view(found))
    top, bottom = figure.axes
    measured, *models = top.lines
    assert [line.get_label() for line in models] == ["base model", "final model"]
    np.testing.assert_allclose(measured.get_ydata(), 1.0 + np.arange(INCREMENTS))
    np.testing.assert_allclose(models[1].get_ydata(), measured.get_ydata(), rtol=1e-6)
    base = np.abs(bottom.lines[0].get_ydata())
    assert (base > 1e-3).sum() == len(HELD)
    columns, rows = course_rows(force_courses(found), [part.experiment for part in found.problem.parts])
    table = {
        name: [row for row in rows if row[columns.index("model")] == name] for name in ("base model", "final model")
    }
    for line, drawn in zip(models, table.values(), strict=True):
        assert [row[columns.index("replayed")] for row in drawn] == pytest.approx(list(line.get_ydata()))
        assert [row[columns.index("increment")] for row in drawn] == list(range(1, INCREMENTS + 1))
        assert np.flatnonzero([row[columns.index("held_out")] for row in drawn]).tolist() == list(HELD)


def test_few_effects_that_compete_are_drawn_and_in_the_table_with_their_average():
    """Beside neo-Hooke and the most probable: each by its effects, and what all together miss."""
    right, wrong = check(observations()), check(observations(only_held(30.0)))
    few = few_effects(right.final, wrong.final)
    second = replace(few.models[0], effects=("lens distortion",), probability=0.5)
    models = tuple(replace(one, updated=replace(one.updated, check=checked)) for one, checked in zip((few.models[0], second), (right, wrong), strict=True))  # fmt: skip
    found = replace(nothing(), verdict=Verdict.NOT_EXPLAINED, replay_check=wrong, few=replace(few, models=models))
    figure = figures.replayed_forces(view(found))
    names = ["base model", "neo-Hooke", "few effects", "few effects: lens distortion"]
    assert [line.get_label() for line in figure.axes[0].lines] == ["measured", *names]
    average = average_of_few(found)
    _, rows = replay_table(wrong, replayed_models(found), updated_bands(found), average)
    assert [row[0] for row in rows][:5] == [*names, "few effects, averaged by their probabilities"]
    first, other = right.final.rows, wrong.final.rows
    forces, mean = first.judged & first.is_force, (first.residual + 0.5 * other.residual) / 1.5
    assert average.judged == pytest.approx(np.linalg.norm(mean[forces]) / np.linalg.norm(first.measured[forces]))
    files = set(
        unexplained(found, "half", dict.fromkeys(("command", "settings", "inputs", "versions", "revision"), ""))
    )
    assert files == {"model_few_effects.json", "model_few_effects_2.json", "model_neo_hooke.json"}


def test_a_model_that_corrects_the_load_cell_is_drawn_as_the_cell_reads():
    """Half a newton too little was read, and the model replays the true force: the line is on the circles."""
    read = observations()
    true = replace(read, **{name: getattr(read, name) + 0.5 * read.is_force for name in ("measured", "replayed")})
    base, final = force_courses(replace(explained(), replay_check=check(true, read)))
    assert final.measured == pytest.approx(base.measured) and base.measured == pytest.approx(
        1.0 + np.arange(INCREMENTS)
    )
    assert final.replayed == pytest.approx(base.measured) and np.abs(final.difference).max() < 1e-9


def test_the_model_to_predict_with_is_said_first():
    """Of what was found its replay; of what nothing explains the final model within its band, else the model that replays best, which may be neo-Hooke, and none where a final model outside of its band does better than both."""
    good, bad = (check(observations(only_held(size))) for size in (1.0, 30.0))
    named_one = replace(explained(), replay_check=good)
    assert recommendation(named_one).startswith("To predict with: model.json. By finite elements")
    fit = few_effects(good.final, bad.final)
    open_one = replace(nothing(), verdict=Verdict.NOT_EXPLAINED, replay_check=bad, few=fit)
    assert recommendation(open_one).startswith("To predict with: model_few_effects.json.")
    assert "identifies no effect" in recommendation(open_one)
    worse = replace(open_one, few=few_effects(bad.final, good.final))
    assert recommendation(worse).startswith("To predict with: model_neo_hooke.json.")
    assert "It is one modulus" in recommendation(worse)
    within = replace(open_one, replay_check=good, few=few_effects(bad.final, bad.final))
    assert recommendation(within).startswith("To predict with: model.json.")
    assert "identifies no effect" in recommendation(within)
    outside = replace(good, judgement=Judgement(ChiSquare(1e4, 6), None, False))
    neither = replace(within, replay_check=outside)
    assert recommendation(neither).startswith("Nothing to predict another test with beyond doubt")
    assert recommendation(replace(open_one, few=None)).startswith(
        "Nothing to predict another test with: nothing explains"
    )


def test_a_model_that_misses_a_quarter_of_the_forces_is_not_recommended():
    """Though it is the best of them: the record is wrong, or its clock."""
    rows = check(observations()).final
    doubled = replace(
        rows, rows=replace(rows.rows, measured=np.where(rows.rows.is_force, 2.0, 1.0) * rows.rows.measured)
    )
    found = replace(nothing(), verdict=Verdict.NOT_EXPLAINED, replay_check=None, few=few_effects(doubled, doubled))
    assert to_predict_with(found) is None
    assert "forces are missed by more than a quarter" in recommendation(found)
    (use,) = (one for one in remarks(view(found)) if one.code is ReplayCode.USE)
    assert "forces by more than a quarter" in use.text


def test_what_comes_nearest_is_said_before_it():
    """With its probability, and as no finding; nothing where neo-Hooke alone is more probable."""
    good, bad = (check(observations(only_held(size))) for size in (1.0, 30.0))
    best = FittedSet((Addition(SecondInvariant(), (0.04,)),), 5.0, ErrorsOfReplay(0.05, 0.02), 0.1, {}, {})
    sets = Alternatives((Explanation(("second invariant",), 0.0, probability=0.7),))
    few = replace(few_effects(good.final, bad.final), alternatives=sets, fitted=(best,))
    found = replace(nothing(), verdict=Verdict.NOT_EXPLAINED, replay_check=bad, few=few)
    first, second, *_ = use_of_models(view(found))
    assert first.startswith("By displacements alone, beside neo-Hooke: second invariant, which leaves 0.02 of 0.02 mm")
    assert "(probability of this set 70 %" in first and "no finding" in first and second.startswith("To predict with")
    none = replace(found, few=replace(few, fitted=()))
    assert not any(line.startswith("By displacements alone") for line in use_of_models(view(none)))


def few_effects(replayed: Any, neo_hooke: Any, c: Any = None) -> FewEffects:
    """The second invariant, with these replays of the model and of neo-Hooke, c (n,)."""
    c = nothing().base.c if c is None else c
    spread = Spread(Directions.of(c, (Addition(SecondInvariant(), (0.04,)),), c[:, None], 1.0), 0.1 * np.eye(2))
    errors = ErrorsOfReplay(0.05, 0.02)
    judgement, held = SimpleNamespace(force=None, field=None), bool(replayed.rows.held.any())
    made = SimpleNamespace(final=replayed, expected=errors, judgement=judgement, held_out=held)
    updated = Updated(spread, errors, errors, True, 6, check=made)
    return FewEffects(c, errors, Alternatives(()), (), (FewModel((), 1.0, updated),), neo_hooke)


def test_a_model_that_is_recommended_is_a_file(tmp_path):
    """Neo-Hooke at the level of its replay, where that misses the least; and where it alone was replayed."""
    good, bad, found = check(observations(only_held(1.0))), check(observations(only_held(30.0))), nothing()
    neo_hooke = np.full_like(found.base.c, 0.14)
    few = few_effects(bad.final, good.final, neo_hooke)
    open_one = replace(found, verdict=Verdict.NOT_EXPLAINED, replay_check=bad, few=few)
    record = dict.fromkeys(("command", "settings", "inputs", "versions", "revision"), "of a test")
    models = unexplained(open_one, "half", record)
    file = to_predict_with(open_one)
    assert file == "model_neo_hooke.json" and set(models) == {file, "model_few_effects.json"}
    models[file].save(tmp_path / file)
    loaded = ExtendedModel.load(tmp_path / file)
    assert loaded.additions == () and loaded.c == pytest.approx(good.final.level.factor * neo_hooke)
    alone = replace(
        open_one, replay_check=None, few=replace(few, models=(FewModel((), 1.0, NoReplayCheck("no equilibrium")),))
    )
    assert "no other model was replayed" in recommendation(alone)
    assert unexplained(replace(open_one, few=None), "half", record) == {}


@pytest.mark.parametrize(("more", "file"), [(0.8, "model_few_effects.json"), (1.2, None)])
def test_fields_that_noise_cannot_tell_apart_refuse_no_model_that_meets_the_forces(more, file):
    """What one misses more, in quadrature, over the noise of the camera."""
    good, bad = (check(observations(only_held(size))) for size in (1.0, 30.0))
    noise = nothing().problem.trained[0].experiment.noise.total_std
    rows = replace(good.final.rows, squares=good.final.rows.squares + (more * noise) ** 2)
    few = few_effects(replace(good.final, rows=rows), bad.final)
    of_base = replace(good if file is None else bad, judgement=Judgement(ChiSquare(1e4, 6), None, False))
    found = replace(nothing(), verdict=Verdict.NOT_EXPLAINED, replay_check=of_base, few=few)
    said = f"To predict with: {file}." if file else "Nothing to predict"
    assert recommendation(found).startswith(said)


def test_the_moduli_of_a_base_are_those_of_its_energy():
    """A clamped spline takes its first and last coefficient at its ends."""
    model = StandInModel()
    assert report.base_moduli(model, 4.0) == pytest.approx([2 * model.c[0], 2 * model.c[-1]])


def test_report_and_data_are_written(tmp_path):
    manifest = StandInManifest()
    path = report.write(tmp_path, view(explained()), StandInModel(), manifest)
    text = path.read_text()
    assert len(text) < 5_000_000
    assert text.count("<figure>") == 5
    assert "http:" not in text
    assert "https:" not in text
    for words in ("Explained: second invariant", "needs unloading", "Round 2", "cannot be told from"):
        assert words in text
    assert manifest.results["verdict"] == "explained"
    assert set(manifest.outputs) == {
        "report.html", "model.json", "discovery.json", "effects.csv", "amplitudes.csv", "forces.csv", "residuals.npz", "curves.csv",
        "curves.png", "residual_map.png", "scores.png", "amplitudes.png", "forces.png",
    }  # fmt: skip
    everything = json.loads((tmp_path / "discovery.json").read_text())
    assert everything["verdict"] == "explained"
    assert [one["text"] for one in everything["alerts"]] == [one.text for one in in_order(remarks(view(explained())))]
    assert all(f'href="#{one["code"].lower()}"' in text for one in everything["alerts"])
    rows = _table(tmp_path / "effects.csv")
    assert [(r["round"], r["effect"]) for r in rows][:1] == [("1", "second invariant")]
    assert len(rows) == 9
    last = _table(tmp_path / "amplitudes.csv")[-1]
    assert (last["round"], last["effect"], last["tested"]) == ("model", "second invariant", "nan")
    assert float(last["fitted"]) == pytest.approx(
        view(explained()).level * explained().final.additions[0].amplitudes[0]
    )
    read = _table(tmp_path / "forces.csv")
    right = [float(r["measured"]) for r in read if (r["boundary"], r["component"]) == ("right", "x")]
    assert right == pytest.approx(sheet().loaded[1].force[:, 0])
    with np.load(tmp_path / "residuals.npz") as maps:
        assert maps["experiment_1_final_model"].shape == (6, len(sheet().points))


def test_quick_report_has_fewer_pictures(tmp_path):
    found = replace(view(nothing()), quick=True)
    text = report.write(tmp_path, found, StandInModel(), StandInManifest()).read_text()
    assert text.count("<figure>") == 4


def _table(path):
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def test_a_replay_is_said_and_its_level_is_that_of_the_amplitudes():
    """Forces are 7 % too large as the model was fitted: c01 as stated is as much smaller."""
    found = replace(explained(), replay_check=check(observations(stiffness=1.07), observations()))
    (said,) = (one.text for one in remarks(view(found)) if one.code is ReplayCode.REPLAYED)
    assert "held out" in said and "x 0.93" in said
    (before,), (after,) = (Statement.of(view(one)).named[0].values for one in (explained(), found))
    values = [float(text.split("=")[1].split("+-")[0]) for text in (before, after)]
    assert values[1] == pytest.approx(values[0] / 1.07, rel=1e-2)
    rows = replay_table(found.replay_check)[1]
    assert [row[0] for row in rows] == ["base model", "final model", "half of the 95 % band of the final model"]
    assert len(band_rows(found.replay_check, ["plate"], [None])[1]) == INCREMENTS
    fields = band_fields(found.replay_check, ["plate"])[1]
    assert len(fields) == INCREMENTS and all(row[-1] > 0 for row in fields)
    content_of_file = json.loads(json.dumps(content(view(found))))
    assert content_of_file["replay"]["final"]["level"] == pytest.approx(1 / 1.07)


def test_what_makes_a_wide_band_is_said():
    """A competing explanation by its effects; nothing of a band that is no wider than the error of a load cell."""
    one = check(observations())
    forces = np.diag(100 * np.square(np.where(one.final.rows.is_force, one.final.rows.measured, 0.0)) * 1e-4)
    for part, words in ((ALTERNATIVES, "a competing explanation, lag and axis gain,"), (BEYOND, "extrapolation")):
        band = Band({**one.band.parts, part: forces}, {("lag", "axis gain"): np.diag(forces)})
        found = replace(explained(), replay_check=replace(one, band=band))
        (said,) = (each.text for each in remarks(view(found)) if each.code is ReplayCode.REPLAYED)
        assert f"band 20 %, most of it by {words}" in said
        kept = json.loads(json.dumps(content(view(found))))["replay"]["largest_part_of_force_band"]
        assert kept == {"part": part, "effects": ["lag", "axis gain"] if part == ALTERNATIVES else []}
    (said,) = (
        each.text for each in remarks(view(replace(explained(), replay_check=one))) if each.code is ReplayCode.REPLAYED
    )
    assert "most of it" not in said


def test_a_residual_that_is_noise_is_called_so_where_what_was_held_out_is_not():
    last = explained().rounds[-1]
    missed = replace(last, predicted=ChiSquare(3.0 * last.predicted.degrees, last.predicted.degrees))
    said = verdict(view(replace(explained(), rounds=(explained().rounds[0], missed), verdict=Verdict.NOT_EXPLAINED,
                                named=(), closest=explained().named)))  # fmt: skip
    assert "the residual is no more than noise (" in said and "which is missed by more than noise)" in said


def test_verdict_tables_pictures_and_errors_are_at_the_level_of_the_replay():
    """Forces that are replayed too small by a third ask for a material that is half as stiff again."""
    rows = observations()
    small = check(replace(rows, replayed=np.where(rows.is_force, rows.measured / 1.5, rows.replayed)))
    parameter = SecondInvariant().amplitudes[0]
    power = Power(SecondInvariant(), PowerFinding.FOUND, parameter, (0.03, 0.001))
    weighing = Weighing(Alternatives.of([Explanation(("second invariant",), 0.0)]), {}, (power,), True)
    one = view(replace(explained(), replay_check=small, weighing=weighing))
    (fitted,), level = (a.amplitudes for a in one.discovery.final.additions), small.final.level.factor
    assert level == pytest.approx(1.5) == one.level
    (told,) = one.weighing.powers
    assert told.value == pytest.approx((0.03 * level, 0.001 * level))
    (drawn, *_) = (line.get_xdata() for line in figures.intervals(one).axes[0].lines if line.get_label() != "_child")
    assert drawn == pytest.approx([level * fitted[0]])
    (_, last), final = one.errors, one.discovery.final
    stiff = misfit(one.discovery.problem, level * final.c, tuple(a.stiffer(level) for a in final.additions), True)
    assert last[1].force == stiff.force > 2 * one.discovery.rounds[-1].held.force
    assert Statement.of(one).errors.force_after == stiff.force
