"""The report of a discovery: what it says of effects that are there, that are not, and that cannot be seen."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from discoveries import C01, explained, held, nothing, sheet, view
from matplotlib.figure import Figure

from calibrate.diagnosis.selection import Discovery
from studies.reports import discovery_figures, discovery_report, discovery_words
from studies.reports.discovery_review import (
    amplitudes,
    content,
    decorrelated,
    deviations,
    forces,
    held_increments,
    nodal,
    record,
)


def row(name: str, number: int = 0):
    now = explained().rounds[number]
    return next(r for r in now.rows if r.name == name), now


def without_noise(found: Discovery) -> Discovery:
    return replace(found, problem=replace(found.problem, noise_is_known=False))


# --- numbers --------------------------------------------------------------------------------------------------


def test_residuals_of_the_true_model_stay_within_noise_and_discretisation():
    """The data have no discretisation error, for which the covariance leaves room: below one, not at it."""
    part = explained().problem.parts[0]
    z, before = decorrelated(part, explained().final), decorrelated(part, explained().base)
    assert np.isfinite(z).all()
    assert np.mean(z**2) < 1
    assert np.mean(before**2) > 4 * np.mean(z**2)


def test_sum_of_squares_is_the_chi_square_where_nothing_is_common_to_increments():
    """Whitening by a symmetric root or by Cholesky's: the same size."""
    part = explained().problem.parts[0]
    plain = replace(
        part,
        train=replace(part.train, U=part.train.U[:, :0], shrink=part.train.shrink[:0]),
        held=replace(part.held, U=part.held.U[:, :0], shrink=part.held.shrink[:0]),
    )
    z, fit = decorrelated(plain, explained().base), explained().base
    r = part.residual(fit.c)
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
    (amplitude,) = amplitudes(row("second invariant")[0], "MPa")
    assert amplitude["low_95"] < C01 < amplitude["high_95"]
    assert amplitude["high_95"] - amplitude["fitted"] == pytest.approx(1.96 * amplitude["fitted_deviation"])
    assert amplitude["unit"] == "MPa"
    assert (amplitude["lowest"], amplitude["highest"]) == (0.0, None)


def test_predicted_improvement_is_achieved():
    """The score test is a linearisation about no effect; here the effect explains all but noise."""
    found = record(*row("second invariant"), "MPa")
    assert 0.5 < found["predicted_improvement"] < 1
    assert found["achieved_improvement"] == pytest.approx(found["predicted_improvement"], abs=0.2)
    assert found["held_out_after"]["force_error"] < found["held_out_before"]["force_error"]


def test_everything_can_be_written_as_json():
    everything = content(view(explained()))
    again = json.loads(json.dumps(everything))
    assert [len(now["candidates"]) for now in again["rounds"]] == [5, 4]
    assert again["experiments"][0]["held_out_increments"] == (np.flatnonzero(held()) + 1).tolist()


# --- words ----------------------------------------------------------------------------------------------------


def test_verdict_names_effect_amplitude_and_errors():
    text = discovery_words.verdict(view(explained()))
    assert text.startswith("explained: second invariant (c01 = 0.0")
    assert "MPa" in text
    assert "force error" in text
    assert "held out (every third increment)" in text
    assert "cannot be told from: nothing else" in text


def test_verdict_of_a_tie_names_what_would_decide():
    tied = replace(explained(), groups={"second invariant": ("second invariant", "stiffness gradient")})
    text = discovery_words.verdict(view(tied))
    assert "cannot be told from: stiffness gradient" in text
    assert "decided by: an equi-biaxial test" in text
    assert "strips cut from different places" in text


def test_nothing_significant():
    text = discovery_words.verdict(view(nothing()))
    assert nothing().verdict == "nothing significant"
    assert text.startswith("nothing significant: no candidate is significant")
    assert "no more than noise" in text


def test_not_explained_says_how_much_is_left():
    found = replace(explained(), verdict="significant, not explained", named=(), closest=("second invariant",))
    assert "not explained: the closest is second invariant" in discovery_words.verdict(view(found))
    alone = replace(nothing(), verdict="significant, not explained")
    assert "not explained by any candidate" in discovery_words.verdict(view(alone))
    assert "may well be a false alarm" in discovery_words.verdict(view(alone))
    loud = replace(alone.rounds[-1], predicted=(100.0, 10))
    assert "false alarm" not in discovery_words.verdict(view(replace(alone, rounds=(*alone.rounds[:-1], loud))))


def test_unknown_noise_gives_no_p_value():
    found = view(without_noise(nothing()))
    assert "noise is unknown" in discovery_words.verdict(found)
    columns, rows = discovery_words.model_table(found)
    assert rows[0][columns.index("p")] is None
    assert any("Give the noise" in text for text in discovery_words.remarks(found))


def test_nothing_held_out_is_said():
    rounds = tuple(replace(now, held=None) for now in explained().rounds)
    found = replace(view(replace(explained(), rounds=rounds)), hold_out="nothing")
    assert any("Nothing was held out" in text for text in discovery_words.remarks(found))
    assert "nothing was held out" in discovery_words.verdict(found)


def test_table_has_a_row_for_every_candidate():
    columns, rows = discovery_words.candidate_table(explained().rounds[0], "MPa")
    by_name = {r[0]: dict(zip(columns, r, strict=True)) for r in rows}
    assert by_name["second invariant"]["outcome"] == "added"
    assert by_name["stiffness gradient"]["outcome"] == "not significant"
    assert by_name["viscoelasticity"]["outcome"] == "not testable, needs time"
    assert by_name["Mullins softening"]["outcome"] == "not testable, needs unloading"
    assert by_name["force gain"]["outcome"].startswith("gauge: cannot be told from")
    assert by_name["force gain"]["score"] is None
    before = next(name for name in columns if name.startswith("force error, held out"))
    assert by_name["second invariant"][before] < by_name["stiffness gradient"][before]


def test_second_table_shows_what_is_in_the_model():
    _, rows = discovery_words.candidate_table(explained().rounds[1], "MPa")
    assert rows[0][:2] == ["second invariant", "in the model"]
    assert rows[0][8].startswith("c01 = 0.0")
    assert rows[0][8].endswith("MPa")


def test_noise_that_is_overstated_is_remarked():
    assert not any("overstated" in text for text in discovery_words.remarks(view(nothing())))
    found = nothing()
    fit = found.rounds[0].fit
    quiet = replace(
        found, rounds=(replace(found.rounds[0], fit=replace(fit, free_loss=0.1 * fit.degrees)), *found.rounds[1:])
    )
    assert any(
        "reduced chi-square 0.1): the noise is overstated" in text for text in discovery_words.remarks(view(quiet))
    )


def test_refusals_are_told_in_the_table():
    first, now = row("stiffness gradient")
    strong = replace(first, score=replace(first.score, adjusted=1e-4))
    refused = replace(now, added=None, remarks=("stiffness gradient: the error on held-out data does not fall",))
    outcome = discovery_words.outcome
    assert outcome(strong, refused) == "significant, refused: the error on held-out data does not fall"
    assert outcome(strong, now) == "significant, another was better"
    assert outcome(replace(strong, fit=None), now) == "significant, not refitted: another has a higher score"
    negative = replace(strong, score=replace(strong.score, admissible=False))
    assert outcome(negative, now) == "significant, not admissible"


@pytest.mark.parametrize(
    ("value", "half", "text"),
    [(0.016334, 0.00052, "0.01633 +- 0.00052"), (12.3456, 1.5, "12.3 +- 1.5"), (1234.5, 250.0, "1234 +- 250")],
)
def test_amplitudes_have_the_digits_they_deserve(value, half, text):
    assert discovery_words.plus_minus(value, half) == text


# --- figures and files ----------------------------------------------------------------------------------------


def test_figures_show_both_models():
    part = explained().problem.parts[0]
    found = view(explained())
    assert len(discovery_figures.residual_map(found, part).axes) == 2 * 3 + 1
    history = discovery_figures.force_history(found, part)
    assert {line.get_label() for line in history.axes[0].lines} == {"measured", "base model", "final model"}
    assert len(discovery_figures.scores(found).axes) == 2
    assert isinstance(discovery_figures.intervals(found), Figure)
    assert discovery_figures.intervals(view(nothing())) is None


class StandInModel:
    """Instead of a model with a network, which is tested elsewhere."""

    unit, additions, network = "MPa", (), None

    def save(self, path):
        path.write_text("{}")


class StandInManifest:
    def to_dict(self):
        return {"settings": {}, "versions": {}}

    def beside(self, *outputs, **results):
        self.outputs, self.results = [path.name for path in outputs], results


def test_report_and_data_are_written(tmp_path):
    manifest = StandInManifest()
    path = discovery_report.write(tmp_path, view(explained()), StandInModel(), manifest)
    text = path.read_text()
    assert len(text) < 5_000_000
    assert text.count("<figure>") == 4
    assert "http:" not in text
    assert "https:" not in text
    for words in ("Explained: second invariant", "needs unloading", "Round 2", "cannot be told from"):
        assert words in text
    assert manifest.results["verdict"] == "explained"
    assert set(manifest.outputs) == {
        "report.html", "model.json", "discovery.json", "effects.csv", "amplitudes.csv", "forces.csv", "residuals.npz",
    }  # fmt: skip
    assert json.loads((tmp_path / "discovery.json").read_text())["verdict"] == "explained"
    rows = _table(tmp_path / "effects.csv")
    assert [(r["round"], r["effect"]) for r in rows][:1] == [("1", "second invariant")]
    assert len(rows) == 9
    read = _table(tmp_path / "forces.csv")
    right = [float(r["measured"]) for r in read if (r["boundary"], r["component"]) == ("right", "x")]
    assert right == pytest.approx(sheet().loaded[1].force[:, 0])
    with np.load(tmp_path / "residuals.npz") as maps:
        assert maps["experiment_1_final_model"].shape == (6, len(sheet().points))


def test_quick_report_has_fewer_pictures(tmp_path):
    found = replace(view(nothing()), quick=True)
    text = discovery_report.write(tmp_path, found, StandInModel(), StandInManifest()).read_text()
    assert text.count("<figure>") == 3


def _table(path):
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))
