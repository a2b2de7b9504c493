"""The study on measured data: pictures that are compared, steps that are kept, the commands that it runs, its report."""

import json
from dataclasses import replace

import numpy as np
import pytest
from discoveries import sheet

from calibrate import errors
from studies.commands import measured
from studies.commands.discover import discover
from studies.commands.transfer import transfer
from studies.output import Manifest
from studies.sheets import report
from studies.sheets.measured_control import groups, interpolation
from studies.sheets.sheet_results import BASE, FOUND, ControlResult, MeasuredResults, SheetResult, TransferResult


def test_pictures_are_not_compared_across_a_gap():
    time = 0.2 * np.arange(100)
    time[51:] += 0.4
    frames = np.array(groups(time, 10)).reshape(-1, 5)
    assert (frames - frames[:, [2]] == [-3, -1, 0, 1, 3]).all()
    assert len(set(frames.ravel())) == frames.size
    assert np.ptp(time[frames], axis=1).max() < 1.3


@pytest.mark.parametrize("time", [np.arange(5.0), np.arange(6.0), np.array([0, 1, 2, 30, 31, 32, 60.0])])
def test_a_record_too_short_for_the_control_is_named(time):
    with pytest.raises(errors.ExperimentError, match=f"{len(time)} pictures have none; record more"):
        groups(time, 3)


def test_what_grows_as_a_cubic_drops_out_of_the_difference():
    times = np.array([[0.0, 0.4, 0.8, 1.3], [2.0, 2.4, 2.8, 3.2]])
    at = np.array([0.6, 2.6])
    cubic = np.polynomial.Polynomial([1.0, -2.0, 0.5, 0.3])
    weights = interpolation(at, times)
    assert (weights * cubic(times)).sum(axis=1) == pytest.approx(cubic(at), abs=1e-12)
    assert weights[1] == pytest.approx([-1 / 16, 9 / 16, 9 / 16, -1 / 16])


def steps(folder):
    return measured.Steps(folder, measured.SheetStudy(), False, lambda text: None)


def control(name="sheet", p=1.0):
    return ControlResult(name, 14, 1.0, p, [])


def test_a_step_is_made_once(tmp_path):
    made = []
    for _ in range(2):
        result = steps(tmp_path).step("one", ControlResult, lambda: made.append(1) or control())
    assert replace(result, seconds=None) == control() and result.seconds == 0.0 and len(made) == 1


def test_absent_data_are_named_before_anything_is_made(tmp_path, monkeypatch):
    from studies.importers import measured_data

    def absent(name):
        raise errors.DataNotFoundError(f"data file {name} not found")

    monkeypatch.setattr(measured_data, "sheet", absent)
    with pytest.raises(errors.DataNotFoundError, match="Soft_Homo"):
        measured.measured(quick=True, output=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_study_says_what_the_commands_say(tmp_path):
    """The verdict, errors and factors are those that `discover` and `transfer` leave."""
    sheet().save(tmp_path / "sheet.npz")
    sheet(seed=2).save(tmp_path / "other.npz")
    done = discover(tmp_path / "sheet.npz", quick=True, output=tmp_path / "found")
    one = SheetResult.of("sheet", json.loads((tmp_path / "found" / "discovery.json").read_text()))
    assert one.verdict == done.view.discovery.verdict
    assert one.named == list(done.view.discovery.named)
    assert [m.name for m in one.models] == [BASE, FOUND]
    assert one.model(FOUND).held_out.force == pytest.approx(done.view.discovery.rounds[-1].held.force)
    assert SheetResult.from_dict(json.loads(json.dumps(one.to_dict()))) == one
    assert [r.name for r in one.replays] == [BASE, FOUND] and one.replays[1].level == pytest.approx(1.0, abs=0.05)
    assert one.replays[1].held_out == done.view.discovery.replay_check.final.judged.force
    moved = transfer(tmp_path / "found" / "model.json", tmp_path / "other.npz", output=tmp_path / "moved")
    two = TransferResult.of(moved.found, ["It is."])
    assert TransferResult.from_dict(json.loads(json.dumps(two.to_dict()))) == two
    assert moved.found.row("stiffness refitted").stiffness == pytest.approx(1.0, abs=0.05)
    results = MeasuredResults({"sheet": one}, {"sheet": two}, {"sheet": control()}, [])
    path, answer = report.write(tmp_path / "out", results, Manifest())
    assert answer.splitlines()[-1] == "between neighbouring pictures: nothing significant"
    assert {p.name for p in path.parent.iterdir()} >= {"measured.json", "verdicts.csv", "errors.csv", "errors.png"}
    assert set(json.loads((path.parent / "measured.json").read_text())) == {
        "sheet_sheet",
        "transfer_sheet",
        "control_sheet",
    }
