"""A run that is killed at any stage ends as one that is not, and a checkpoint is read by nobody else."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from discoveries import NOISE, explained, few, sheet

from calibrate.diagnosis.discovery import discover
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.selection import Discovery
from calibrate.effects import CATALOGUE
from calibrate.fitting.resumable import SILENT, Resumable
from studies.output import run_progress
from studies.output.folder import CHECKPOINT, complete, earlier_answer, open_output_folder, released_if_refused
from studies.output.run_progress import RunProgress


class Killed(RunProgress):
    """Ends the run as soon as it has kept something new."""

    def save(self, stage, value):
        super().save(stage, value)
        raise KeyboardInterrupt


def found(progress: Resumable, correlated: bool) -> Discovery:
    """correlated: with noise that stays with the specimen, and what weights of its own need."""
    data = replace(sheet(), noise=replace(NOISE, pattern_std=0.002, correlation_time=1.0)) if correlated else sheet()
    if correlated:
        data = replace(data, time=np.arange(1.0, 7.0))
    return discover([data], HoldOut("every", 3), effects=few(), say=progress)


@pytest.mark.parametrize("correlated", [False, True])
def test_a_diagnosis_that_is_killed_at_every_stage_ends_the_same(tmp_path, correlated):
    path, kills = tmp_path / "checkpoint.pickle", 0
    while True:
        try:
            end = found(Killed(path), correlated)
            break
        except KeyboardInterrupt:
            kills += 1
            assert kills < 20
    assert kills >= 3  # base model, rounds, evidence
    whole = found(SILENT, True) if correlated else explained()
    assert bool(whole.problem.parts[0].together) == correlated
    assert (end.verdict, end.named, end.groups) == (whole.verdict, whole.named, whole.groups)
    for now, then in zip(end.rounds, whole.rounds, strict=True):
        np.testing.assert_array_equal(now.fit.c, then.fit.c)
        assert now.fit.loss == then.fit.loss
        assert [a.amplitudes for a in now.fit.additions] == [a.amplitudes for a in then.fit.additions]
        assert [c.score.score for c in now.candidates] == [c.score.score for c in then.candidates]
    assert end.weighing is not None
    assert whole.weighing is not None
    assert [e.probability for e in end.weighing.alternatives.explanations] == [
        e.probability for e in whole.weighing.alternatives.explanations
    ]
    assert all(any(a.effect is one for one in CATALOGUE) for a in end.final.additions)  # compiled code is found by them


def test_what_stages_share_stays_shared(tmp_path):
    path, shared = tmp_path / "checkpoint.pickle", np.arange(3.0)
    progress = RunProgress(path)
    progress.save("first", [shared])
    progress.save("second", {"a": shared})
    again = RunProgress(path)
    assert again.load("first")[0] is again.load("second")["a"]
    assert again.load("third") is None
    assert again.checkpointed("first", lambda: pytest.fail("made again")) == again.load("first")
    assert again.earlier_seconds > 0
    again.finished()
    assert not path.exists()


def test_a_checkpoint_of_other_code_or_a_damaged_one_is_not_used(tmp_path, capsys, monkeypatch):
    path = tmp_path / "checkpoint.pickle"
    RunProgress(path).save("first", 1)
    with monkeypatch.context() as other:
        other.setattr("studies.output.manifest.source_hash", lambda: "of other code")
        assert RunProgress(path).load("first") is None
    assert "is of another version; starting from the beginning" in capsys.readouterr().err
    with monkeypatch.context() as other:
        other.setattr(run_progress.os, "getuid", lambda: path.stat().st_uid + 1)
        assert RunProgress(path).load("first") is None
    assert RunProgress(path).load("first") == 1
    half = tmp_path / ".checkpoint-half.pickle"  # of a run that was killed while it wrote
    half.write_bytes(path.read_bytes()[:-5])
    assert RunProgress(path).load("first") == 1
    assert not half.exists()
    path.write_bytes(path.read_bytes()[:-5])
    capsys.readouterr()
    assert RunProgress(path).load("first") is None
    assert "cannot be read" in capsys.readouterr().err


def test_what_cannot_be_kept_ends_no_run(tmp_path, capsys):
    path = tmp_path / "checkpoint.pickle"
    progress = RunProgress(path)
    progress.save("first", 1)
    progress.save("second", lambda: 2)
    assert "goes on from the last one that is there" in capsys.readouterr().err
    assert RunProgress(path).load("first") == 1 and list(tmp_path.iterdir()) == [path]
    assert progress.checkpointed("third", lambda: 3) == 3


def test_what_is_cached_is_left_out(tmp_path):
    path, problem = tmp_path / "checkpoint.pickle", explained().problem
    assert "blocks" in vars(problem.parts[0].chain)
    RunProgress(path).save("first", problem)
    again = RunProgress(path).load("first")
    assert "blocks" not in vars(again.parts[0].chain)
    np.testing.assert_array_equal(
        again.parts[0].chain.residual(again.weights_c), problem.parts[0].chain.residual(problem.weights_c)
    )
    assert path.stat().st_size < len(pickle.dumps(problem, 5))


def test_what_a_chain_remembers_is_worked_out_again(tmp_path):
    """Its triangles in blocks, too: the same numbers."""
    chain, c = explained().problem.parts[0].chain.remembering(), explained().final.c
    expected = chain.residual(c)
    assert chain.divided and chain.memories
    RunProgress(tmp_path / "checkpoint.pickle").save("chain", chain)
    again = RunProgress(tmp_path / "checkpoint.pickle").load("chain")
    assert again.divided is None and again.memories is None
    np.testing.assert_array_equal(again.residual(c), expected)
    assert (tmp_path / "checkpoint.pickle").stat().st_size < 0.7 * len(pickle.dumps(chain, 5))


def test_a_folder_is_complete_as_long_as_what_its_manifest_lists_is_there(tmp_path, monkeypatch):
    folder = open_output_folder(tmp_path / "out", False, {"command": "one"})
    assert earlier_answer(folder) is None
    (folder / "table.csv").write_text("1\n")
    (folder / "report.json").write_text(json.dumps({"outputs": {"table.csv": "hash"}}))
    complete(folder, ["found 1", f"report: {folder / 'report.html'}"])
    assert open_output_folder(folder, False, {"command": "one"}) == folder
    monkeypatch.chdir(tmp_path)
    assert earlier_answer(Path("out")) == (
        "out is complete; --overwrite makes it again",
        "found 1",
        "report: out/report.html",
    )
    with monkeypatch.context() as other:
        other.setattr("studies.output.manifest.source_hash", lambda: "of other code")
        assert "by another version of the code" in earlier_answer(folder)[0]
    (folder / "table.csv").unlink()
    assert earlier_answer(folder) is None


@pytest.mark.parametrize(("error", "left"), [(ValueError, []), (MemoryError, ["checkpoint.pickle", "run.json"])])
def test_an_error_frees_the_folder_unless_the_run_may_go_on(tmp_path, error, left):
    folder = open_output_folder(tmp_path / "out", False, {"command": "one"})
    with pytest.raises(error), released_if_refused(folder):
        RunProgress(folder / CHECKPOINT).save("first", 1)
        raise error
    assert sorted(child.name for child in folder.iterdir()) == left
