"""Blind study: plans, judgement and tables, on made-up diagnoses; one real trial (slow)."""

from __future__ import annotations

import json
from itertools import batched, pairwise

import numpy as np
import pytest
from judged_trials import trial

from calibrate.data.experiment import Experiment
from calibrate.diagnosis import base_fit, score_tests
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.effects.force_offset import ForceOffset
from calibrate.effects.second_invariant import SecondInvariant
from calibrate.errors import ConfigError
from studies import cli
from studies.cli import main
from studies.commandline import application
from studies.errors import OptionError
from studies.output.manifest import Manifest
from studies.trials import blind_case, blind_data, blind_plans, blind_report, judgement
from studies.trials.blind_case import Plan
from studies.trials.blind_data import draw
from studies.trials.trial_summary import ending, pulls, summary


def plans(*words):
    given = application.parse(cli.targets("blind"), ["blind", *words])
    return given["trials"].plans(given["quick"])


def test_every_trial_has_its_own_seed_and_kinds_are_mixed():
    todo = plans("--trials", "2", "--nulls", "4", "--pairs", "2", "--only", "force offset,viscoelasticity")
    assert len({p.seed for p in todo}) == len({p.name for p in todo}) == len(todo) == 10
    assert {len(p.effects) for p in todo[:5]} == {0, 1, 2}
    assert [p.effects for p in todo if p.absent] == [("force offset",), ("viscoelasticity",)]  # the first of each


def test_a_quick_run_has_the_numbers_that_are_given():
    """And few of those that are not; without --quick the usual ones."""
    few = plans("--quick", "--trials", "3", "--only", "force offset")
    assert [len([p for p in few if len(p.effects) == n]) for n in (0, 1, 2)] == [2, 3, 1]
    many = plans("--nulls", "0", "--only", "force offset")
    assert [len([p for p in many if len(p.effects) == n]) for n in (0, 1, 2)] == [0, 20, 20]


def test_trials_of_one_size_follow_each_other():
    todo = plans("--trials", "2", "--nulls", "10", "--pairs", "0")
    ordered = blind_plans.in_order_of_size(todo)
    assert sorted(p.name for p in ordered) == sorted(p.name for p in todo)
    for window in batched(ordered, blind_plans.WINDOW):
        trials = [draw(p.seed, *(p.effects or (None,))) for p in window]
        sizes = [(t.specimen, len(t.factors)) for t in trials]
        assert sum(a != b for a, b in pairwise(sizes)) == len(set(sizes)) - 1


def test_amplitudes_that_are_none_are_not_counted(tmp_path):
    """As those of a warp along an axis that was not bent, which a bound keeps at the true value."""
    home = trial(tmp_path, "warp", ["initial warp"], ["initial warp"], value=1.1)
    label = json.loads((home / "sealed" / "label.json").read_text())
    label["effects"][0]["amplitudes"] = {"a": 0.0, "b": 1.0}
    (home / "sealed" / "label.json").write_text(json.dumps(label))
    content = json.loads((home / "diagnosis.json").read_text())
    content["full"]["additions"][0] |= {"amplitudes": {"a": 0.0, "b": 1.1}, "deviations": {"a": 0.1, "b": 0.1}}
    (home / "diagnosis.json").write_text(json.dumps(content))
    assert pulls(judgement.judge(home)) == [pytest.approx(1.0)]


def test_diagnosis_hits_misses_and_wrong_names_are_told(tmp_path):
    homes = [
        trial(tmp_path, "hit", ["force offset"], ["force offset"], value=1.1, absent=["twin"]),
        trial(tmp_path, "group", ["twin"], ["force offset"]),
        trial(tmp_path, "wrong", ["lens distortion"], ["force offset"], absent=["viscoelasticity"]),
        trial(tmp_path, "weak", ["force offset"], verdict="nothing significant", score=2.0),
        trial(tmp_path, "null", [], verdict="nothing significant"),
        trial(tmp_path, "alarm", [], verdict="significant, not explained"),
        trial(
            tmp_path,
            "pair",
            ["force offset", "viscoelasticity"],
            ["force offset", "viscoelasticity"],
            value=2.0,
            beside=101.0,
        ),
        trial(tmp_path, "lesser", ["force offset", "viscoelasticity"], ["force offset"], closest=["viscoelasticity"]),
        trial(tmp_path, "half", ["force offset", "viscoelasticity"], ["force offset"]),
        trial(tmp_path, "imitated", ["force offset", "viscoelasticity"], ["force offset"], beside=1.0),
    ]
    text = blind_report.write_report(tmp_path, homes, {}, Manifest())
    numbers = json.loads((tmp_path / "summary.json").read_text())
    assert (numbers["nulls"], numbers["null_detections"], numbers["null_names"]) == (2, 1, 0)
    assert numbers["endings"] == {"right": 1, "beside": 0, "group": 1, "dominant": 0, "missed": 0, "wrong": 1}
    removed = {"trials": 2, "explained": 2, "alike": 1, "wrong": 1, "dominant": 0, "dominant_alike": 0}
    assert numbers["removed"] == removed
    assert (numbers["amplitudes"], numbers["amplitudes_within"]) == (1, 1)
    assert (numbers["absent"], numbers["absent_wrong"]) == (2, 1)
    assert (numbers["pairs"], numbers["pairs_found"], numbers["pairs_in_model"]) == (3, 1, 2)
    assert numbers["pairs_right"] == 1
    assert (numbers["pairs_clear"], numbers["pairs_clear_found"]) == (1, 1)
    assert (numbers["pairs_at_first"], numbers["pairs_at_first_found"]) == (4, 1)
    broken = blind_report.write_report(tmp_path / "broken", homes, {"twin-7": "ValueError: nothing left"}, Manifest())
    assert broken.startswith(text) and "twin-7 (ValueError: nothing left)" in broken
    confusion = (tmp_path / "confusion.csv").read_text()
    assert confusion.splitlines()[0].startswith("hidden,nothing,unexplained")
    assert (tmp_path / "report.html").exists()
    judged = judgement.judge(homes[0])
    assert judged.amplitudes[0].pulls["a"] == pytest.approx(1.0)
    known = {one.trial: one for one in judgement.read(tmp_path / "trials.json")}
    assert known[homes[0].name] == judged
    elsewhere = [tmp_path / "elsewhere" / home.name for home in homes]
    assert blind_report.write_report(tmp_path / "again", elsewhere, {}, Manifest(), known) == text


def test_a_dominant_effect_is_counted_apart_from_names(tmp_path):
    """It, or one that leaves little more, is no name and no miss; another than what is hidden is wrong."""
    open_verdict = {"verdict": "significant, not explained"}
    homes = [
        trial(tmp_path, "dominant", ["x"], dominant=["x"], absent=[], absent_dominant="y", **open_verdict),
        trial(tmp_path, "like", ["x"], dominant=["y", "x"], absent=[], absent_dominant="twin", **open_verdict),
        trial(tmp_path, "other", ["x"], dominant=["y"], absent=[], **open_verdict),
        trial(tmp_path, "none", ["x"], **open_verdict),
    ]
    judged = [judgement.judge(home) for home in homes]
    assert [ending(one) for one in judged] == ["dominant", "dominant", "wrong", "missed"]
    found = summary(judged)
    assert (found.endings.group_named, found.endings.dominant, found.endings.strong) == (0, 2, 4)
    assert (found.removed.trials, found.removed.explained) == (3, 0)
    assert (found.removed.dominant, found.removed.dominant_alike) == (2, 1)


@pytest.mark.parametrize(
    "words",
    [["--only", "gravity"], ["--trials", "-1"], ["--nulls", "1.5"], ["--trials", "0", "--nulls", "0", "--pairs", "0"]],
)
def test_nonsense_is_refused(words):
    with pytest.raises((ConfigError, OptionError)):
        plans(*words)


def test_trials_of_another_run_are_not_made_again(tmp_path, capsys):
    todo = plans()
    path = tmp_path / "trials.json"
    one = judgement.judge(trial(tmp_path, todo[3].name, ["x"], named=["x"])).to_dict()
    other = {**one, "trial": "something else-1"}
    path.write_text(json.dumps([one, other]))
    assert list(blind_plans.read_known(path, todo)) == [todo[3].name]
    path.write_text(json.dumps([other]))
    assert main(["blind", "--known", str(path), "-o", str(tmp_path / "out")]) == 2
    assert "none of its trials is one of this run" in capsys.readouterr().err
    path.write_text("[1, 2]")
    assert main(["blind", "--known", str(path), "-o", str(tmp_path / "out")]) == 2
    assert "give the trials.json of a blind run" in capsys.readouterr().err


def test_a_report_of_no_trials_is_refused(tmp_path, capsys):
    assert main(["blind", "--report", "-o", str(tmp_path / "out")]) == 2
    assert "no trial is there yet" in capsys.readouterr().err


def test_a_report_does_not_delete_its_trials(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["blind", "--report", "-o", str(out)]) == 2  # an empty folder of this run
    made = trial(out / "trials", plans()[0].name, [], verdict="nothing significant")
    assert main(["blind", "--report", "--overwrite", "-o", str(out)]) == 2
    assert "--overwrite deletes the trials" in capsys.readouterr().err
    assert made.exists()


def test_the_manifest_says_how_trials_were_drawn(tmp_path, monkeypatch):
    monkeypatch.setattr("studies.commands.blind.make_missing", lambda *given: {})
    assert main(["blind", "--quick", "--nulls", "3", "--seed", "7", "--foreign", "-o", str(tmp_path)]) == 0
    manifest = json.loads((tmp_path / "report.json").read_text())
    settings = manifest["settings"]
    assert (manifest["seed"], settings["nulls"], settings["pairs"], settings["foreign"]) == (7, 3, 1, True)


@pytest.mark.slow
def test_a_trial_runs_and_goes_on_where_it_was(tmp_path, capsys):
    words = ["blind", "--trials", "0", "--nulls", "1", "--pairs", "0", "--jobs", "1", "-o", str(tmp_path / "out")]
    assert main(words) == 0
    made = tmp_path / "out" / "trials" / Plan(20000).name / "diagnosis.json"
    time = made.stat().st_mtime_ns
    assert main(words) == 0
    assert made.stat().st_mtime_ns == time
    assert "Nothing hidden" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lag between force and image", "subset smoothing"])
def test_an_effect_whose_shape_is_not_drawn_is_scored_beside_another(tmp_path, name):
    blind_data.write(draw(9016, "second invariant", name), tmp_path)
    beside = blind_case.beside(tmp_path)
    assert set(beside) == {"second invariant", name}
    assert np.isfinite(list(beside.values())).all()


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True, reason="15.9: the offset is hidden, too, and since the base has a prior more of it is seen"
)
def test_an_effect_may_get_its_score_from_another(tmp_path):
    """A force offset stands in for a second invariant that is not in the model yet; beside it nothing is left."""
    blind_data.write(draw(9015, "second invariant", "force offset"), tmp_path)
    experiment = Experiment.load(tmp_path / "experiment.npz")
    problem, base = base_fit.prepare([experiment], [HoldOut().training])
    scores = score_tests.score(problem, base, (SecondInvariant(), ForceOffset()))
    alone = next(s.score for s in scores if s.effect == ForceOffset())
    beside = blind_case.beside(tmp_path)
    assert alone > 1000 and beside["second invariant"] > 1000
    assert beside["force offset"] < 10
