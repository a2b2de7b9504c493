"""A run that is killed at any stage ends as one that is not, and a checkpoint is read by nobody else."""

from __future__ import annotations

import numpy as np
import pytest
from discoveries import explained, few, sheet

from calibrate.diagnosis.discovery import discover
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.selection import Discovery
from calibrate.effects import CATALOGUE
from studies.output import run_progress
from studies.output.folder import complete, earlier_answer, open_output_folder
from studies.output.run_progress import RunProgress


class Killed(RunProgress):
    """Ends the run as soon as it has kept something new."""

    def reached(self, stage, value):
        super().reached(stage, value)
        raise KeyboardInterrupt


def found(progress: RunProgress) -> Discovery:
    return discover([sheet()], HoldOut("every", 3), effects=few(), say=progress)


def test_a_diagnosis_that_is_killed_at_every_stage_ends_the_same(tmp_path):
    path, kills = tmp_path / "checkpoint.pickle", 0
    while True:
        try:
            end = found(Killed(path))
            break
        except KeyboardInterrupt:
            kills += 1
            assert kills < 20
    assert kills == 4  # base model, two rounds, evidence
    whole = explained()
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
    progress.reached("first", [shared])
    progress.reached("second", {"a": shared})
    again = RunProgress(path)
    assert again.earlier("first")[0] is again.earlier("second")["a"]
    assert again.earlier("third") is None
    assert again.kept("first", lambda: pytest.fail("made again")) == again.earlier("first")
    again.finished()
    assert not path.exists()


def test_a_checkpoint_of_other_code_or_a_damaged_one_is_not_used(tmp_path, capsys, monkeypatch):
    path = tmp_path / "checkpoint.pickle"
    RunProgress(path).reached("first", 1)
    with monkeypatch.context() as other:
        other.setattr(run_progress, "source_hash", lambda: "of other code")
        assert RunProgress(path).earlier("first") is None
    assert "is of another version; starting from the beginning" in capsys.readouterr().err
    with monkeypatch.context() as other:
        other.setattr(run_progress.os, "getuid", lambda: path.stat().st_uid + 1)
        assert RunProgress(path).earlier("first") is None
    assert RunProgress(path).earlier("first") == 1
    path.write_bytes(path.read_bytes()[:-5])
    capsys.readouterr()
    assert RunProgress(path).earlier("first") is None
    assert "cannot be read" in capsys.readouterr().err


def test_a_folder_is_complete_as_long_as_all_of_its_files_are_there(tmp_path):
    folder = open_output_folder(tmp_path / "out", False, {"command": "one"})
    assert earlier_answer(folder) is None
    (folder / "deep").mkdir()
    (folder / "deep" / "table.csv").write_text("1\n")
    complete(folder, ["found 1", "report: here"])
    assert open_output_folder(folder, False, {"command": "one"}) == folder
    assert earlier_answer(folder) == ("found 1", "report: here")
    (folder / "deep" / "table.csv").unlink()
    assert earlier_answer(folder) is None
