"""`equigap discover`: what it passes on, what it writes and says, and what it refuses."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from discoveries import FEW, explained, sheet

from calibrate.diagnosis.distillation import distil
from calibrate.effects import CATALOGUE
from calibrate.errors import ConfigError, FitError
from calibrate.models.extended_model import ExtendedModel
from studies.cli import main
from studies.commands import discover as discovery
from studies.errors import OptionError
from studies.output.folder import earlier_answer
from studies.replay.replay_check import FiniteElementCheck
from studies.replay.twin_replay import twin_replay
from studies.reports.discovery import report as discovery_report


@pytest.fixture
def asked(monkeypatch):
    """What the command asked `discover` for; the discovery itself is made once, by tests/discoveries.py."""
    calls = []

    def discover(trained, rule, held, effects, spacing, base, seed, say, **also):
        say("round 1: testing effects")
        calls.append({"trained": trained, "rule": rule, "held": held, "effects": effects, "spacing": spacing,
                      "base": base, "fitted": also["fitted"], "seed": seed, "replay": also["replay"], "check": also["check"]})  # fmt: skip
        return explained()

    monkeypatch.setattr("calibrate.diagnosis.discovery.discover", discover)
    monkeypatch.setattr("calibrate.diagnosis.distillation.distil", partial(distil, layers=(2,), n_starts=2))
    return calls


@pytest.fixture
def run(tmp_path, capsys, asked, monkeypatch):
    """Run the command on the plate: exit code, folder, what was printed. Draws nothing unless told."""
    sheet().save(tmp_path / "plate.npz")
    every = discovery_report.pictures

    def command(*words, also=(), draw=False):
        monkeypatch.setattr(discovery_report, "pictures", every if draw else lambda folder, view: [])
        folder = tmp_path / "out"
        code = main(["discover", str(tmp_path / "plate.npz"), *also, "-o", str(folder), *words])
        said = capsys.readouterr()
        return code, folder, said.out + said.err

    return command


def other(tmp_path, name="other.npz", **changes):
    """A second test in a file: the plate with other noise."""
    path = tmp_path / name
    replace(sheet(seed=2), name="other", **changes).save(path)
    return path


def test_everything_is_written_and_the_verdict_is_said(run, asked):
    code, folder, said = run(draw=True)
    assert code == 0, said
    assert "second invariant" in said.splitlines()[0]
    assert str(folder / "report.html") in said
    assert (folder / "curves.png").exists()
    assert "Stress over stretch" in (folder / "report.html").read_text()
    assert asked[0]["rule"] is None
    assert asked[0]["effects"] == CATALOGUE
    assert asked[0]["replay"] is twin_replay
    assert isinstance(asked[0]["check"], FiniteElementCheck)
    assert (asked[0]["base"], asked[0]["fitted"], asked[0]["seed"]) == ("positive", True, 0)
    model = ExtendedModel.load(folder / "model.json")
    assert model.verdict == "explained"
    assert model.hold_out == "every third increment"
    assert model.network is not None
    manifest = json.loads((folder / "report.json").read_text())
    assert manifest["results"]["verdict"] == "explained"
    assert set(manifest["outputs"]) >= {"report.html", "model.json", "discovery.json", "effects.csv"}
    assert len(manifest["inputs"]) == 1
    pictures = {path.name for path in folder.glob("*.png")}
    assert len(pictures) >= 5 and pictures <= set(manifest["outputs"])
    assert earlier_answer(folder) is not None
    (folder / "scores.png").unlink()
    assert earlier_answer(folder) is None


def test_options_reach_the_search(run, asked, tmp_path):
    path = other(tmp_path)
    code, _, said = run(
        "--hold-out", str(path), "--hold-out", "every:2", "--base", "positive", "--spacing", "9",
        "--without", "force offset", "--without", "lens distortion", "--seed", "4", "--quick",
    )  # fmt: skip
    assert code == 0, said
    call = asked[0]
    assert str(call["rule"]) == "every second increment"
    assert [e.name for e in call["held"]] == ["other"] and "other" in said
    assert {e.name for e in CATALOGUE} - {e.name for e in call["effects"]} == {"force offset", "lens distortion"}
    assert (call["base"], call["fitted"], call["seed"], call["spacing"]) == ("positive", False, 4, 9.0)


def test_same_command_is_taken_up_again_another_is_refused(run):
    assert run("--quick")[0] == 0
    assert run("--quick")[0] == 0
    code, _, said = run()
    assert code == 2
    assert "--overwrite" in said


def test_a_run_is_known_by_what_it_reads_wherever_it_is_called_from(run, asked, tmp_path, monkeypatch):
    assert run()[0] == 0
    monkeypatch.chdir(tmp_path)
    assert main(["discover", "plate.npz", "-o", "out"]) == 0
    assert len(asked) == 1


def test_tests_of_one_name_are_told_apart(tmp_path):
    """By their folders, or by numbers."""
    paths = [
        tmp_path / "a" / "experiment.npz",
        tmp_path / "b" / "experiment.npz",
        tmp_path / "b" / "again.npz",
        tmp_path / "c.npz",
    ]
    for seed, path in enumerate(paths):
        path.parent.mkdir(exist_ok=True)
        replace(sheet(seed=seed), name="export" if seed < 3 else "other").save(path)
    trained, held, _ = discovery.read(paths[:2], paths[2:], None)
    assert [e.name for e in (*trained, *held)] == ["export (a)", "export (b) 1", "export (b) 2", "other"]


@pytest.mark.slow
def test_command_comes_nearest_with_the_second_invariant(tmp_path, capsys):
    """The plate was solved on the camera's own triangles: its replay on finer ones leaves more than the noise, so that nothing explains it."""
    sheet().save(tmp_path / "plate.npz")
    left_out = [w for e in CATALOGUE if e.name not in FEW for w in ("--without", e.name)]
    assert main(["discover", str(tmp_path / "plate.npz"), "-o", str(tmp_path / "out"), "--quick", *left_out]) == 0
    first, second = capsys.readouterr().out.splitlines()[:2]
    assert first == "significant, not explained."
    assert second.startswith("  the closest is second invariant (c01 = 0.030")


# --- bad input ------------------------------------------------------------------------------------------------


def test_unknown_effect_is_named_with_the_nearest():
    with pytest.raises(OptionError, match="force offset"):
        discovery.candidates(["force ofset"])


@pytest.mark.parametrize(
    "texts",
    [
        ["every:1"],
        ["every:x"],
        ["after:soon"],
        ["half:middle"],
        ["sometimes"],
        ["absent.json"],
        ["every:2", "half:left"],
    ],
)
def test_impossible_hold_out_is_named(texts):
    with pytest.raises(ConfigError, match="--hold-out|rule"):
        discovery.hold_outs(texts)


def test_files_and_rules_are_told_apart(tmp_path):
    path = other(tmp_path)
    rule, files = discovery.hold_outs([str(path), "half:left"])
    assert (rule.kind, rule.value, files) == ("half", "left", [path])
    assert discovery.hold_outs([]) == (None, [])


def test_absent_and_wrong_files_are_named(tmp_path, refused):
    sheet().save(tmp_path / "plate.npz")
    np.savez(tmp_path / "wrong.npz", x=1)
    refused("discover", tmp_path / "first.npz", key="first.npz")
    refused("discover", tmp_path / "plate.npz", "--hold-out", "absent.npz", key="absent.npz")
    refused("discover", tmp_path / "wrong.npz", key="wrong.npz")


def test_every_test_is_given_once_and_with_a_thickness_where_the_others_have_one(refused, tmp_path):
    plate, copy = tmp_path / "plate.npz", tmp_path / "copy.npz"
    sheet().save(plate)
    sheet().save(copy)
    refused("discover", plate, "--hold-out", copy, key="copy.npz")
    refused("discover", plate, copy, key="copy.npz")
    path = other(tmp_path)
    refused("discover", plate, "--hold-out", path, "--hold-out", path, key="other.npz")
    refused("discover", plate, "--hold-out", other(tmp_path, thickness=None), key="other.npz")


def test_without_a_time_for_all_there_is_no_time(run, asked, tmp_path):
    timed = other(tmp_path, time=np.arange(1.0, 7.0))
    code, _, said = run("--hold-out", str(timed))
    assert code == 0, said
    assert asked[0]["held"][0].time is None
    code, _, said = run("--hold-out", str(timed), "--hold-out", "after:3", "--overwrite")
    assert code == 2
    assert "time" in said


def test_a_base_that_has_not_converged_is_refused(run, monkeypatch):
    def refuse(*arguments, **also):
        raise FitError("the base model has not converged")

    monkeypatch.setattr("calibrate.diagnosis.discovery.discover", refuse)
    code, folder, said = run()
    assert code == 2
    assert "converged" in said
    assert not (folder / "report.html").exists()


def test_interruption_leaves_nothing_half_written(run, monkeypatch):
    def interrupt(*arguments, **also):
        raise KeyboardInterrupt

    monkeypatch.setattr("calibrate.diagnosis.discovery.discover", interrupt)
    code, folder, _ = run()
    assert code == 130
    assert [path.name for path in folder.iterdir()] == ["run.json"]


def test_the_same_command_in_a_complete_folder_computes_nothing(run, asked):
    _, folder, first = run()
    code, _, said = run()
    assert code == 0
    assert len(asked) == 1
    assert f"{folder} is complete; --overwrite makes it again" in said
    assert first.splitlines()[0] in said  # the same verdict
    (folder / "model.json").unlink()
    run()
    assert len(asked) == 2
    run("--overwrite")
    assert len(asked) == 3
