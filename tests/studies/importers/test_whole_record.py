"""Every picture under load is kept, with the machine record of the whole test; what is left out is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sheets import (
    COLUMNS,
    NOISE,
    ROWS,
    SCALE,
    force,
    frame_text,
    motion,
    packed,
    pixels,
    sheet,
    write,
    write_frames,
)

from calibrate.data.experiment import Experiment
from studies import cli
from studies.importers import printed_sheets
from studies.importers.recording import whole_record as recording
from studies.importers.recording.series import to_experiment
from studies.importers.recording.synchronise import ForceRecord, Selection


@pytest.fixture
def folder(tmp_path) -> Path:
    return write_frames(tmp_path)


def series(record: ForceRecord, stretches=1 + 0.01 * np.arange(12)):
    frames = printed_sheets.Frames(pixels(), np.stack([motion(s) for s in stretches]), 2.0)
    return printed_sheets.sheet_series(frames, record, printed_sheets.SheetOptions(scale=SCALE))


def test_every_picture_and_every_reading_is_kept(folder):
    e = sheet(folder)
    assert e.provenance["frames"] == list(range(1, 12))
    np.testing.assert_allclose(e.record.time, np.linspace(0, 10, 101), atol=1e-9)
    bottom, top = e.record.force
    np.testing.assert_allclose(top[:, 1], force(e.record.time) - force(0), atol=1e-3)  # of frame 0, as the increments
    np.testing.assert_allclose(bottom[:, 1], -top[:, 1])
    assert np.isnan(e.record.force[:, :, 0]).all()
    np.testing.assert_allclose(e.record.at(e.time)[1, :, 1], e.loaded[1].force[:, 1], atol=1e-9)
    np.testing.assert_allclose(e.record.crosshead, 0.4 * e.record.time, atol=1e-3)


def test_the_record_is_whole_whichever_pictures_are_chosen(folder):
    few = sheet(folder, Selection(frames=(2, 5)))
    np.testing.assert_array_equal(few.record.force, sheet(folder).record.force)


def test_a_record_ends_where_the_specimen_failed():
    time = np.linspace(0, 6, 601)
    broken = ForceRecord(time, np.where(time < 4.0, 2 * time, 0.05))
    e = to_experiment(series(broken), noise=NOISE)
    assert e.record.time[-1] <= 4.0
    assert e.time[-1] <= e.record.time[-1]
    assert any("failure" in note for note in e.provenance["notes"])


def test_pictures_without_a_clock_have_no_record():
    one = replace(series(ForceRecord(np.linspace(0, 6, 61), force(np.linspace(0, 6, 61)))), has_clock=False)
    assert to_experiment(one, noise=NOISE).record is None


def test_a_long_record_is_thinned_and_keeps_its_extremes(monkeypatch):
    monkeypatch.setattr(recording, "MOST", 50)
    time = np.linspace(0, 6, 601)
    pull = 2 * time
    pull[333] += 6.0  # one reading, the largest of all
    e = to_experiment(series(ForceRecord(time, pull)), noise=NOISE)
    assert 25 < len(e.record.time) <= 53
    assert (e.record.time[0], e.record.time[-1]) == (0.0, 6.0)
    assert e.record.force[1, :, 1].max() == pytest.approx(pull.max())
    assert any("601 readings" in note for note in e.provenance["notes"])


def test_load_cells_of_their_own_are_read_at_the_times_of_the_machine():
    time, slow = np.linspace(0, 6, 61), np.linspace(-1, 5.8, 18)
    one = series(ForceRecord(time, 0.1 + 2 * time))
    top = replace(one.grips[1], record=ForceRecord(slow, 7.0 + 3 * slow))
    e = to_experiment(replace(one, grips=(one.grips[0], top)), noise=NOISE)
    assert (e.record.time[0], e.record.time[-1]) == (0.0, pytest.approx(5.8))
    np.testing.assert_allclose(e.record.force[0, :, 1], -2 * e.record.time, atol=1e-9)
    np.testing.assert_allclose(e.record.force[1, :, 1], 3 * e.record.time, atol=1e-9)


def test_a_crosshead_with_gaps_is_left_out():
    time = np.linspace(0, 6, 61)
    crosshead = np.where(time == time[7], np.nan, time)
    e = to_experiment(series(ForceRecord(time, force(time), "r", crosshead)), noise=NOISE)
    assert e.record.crosshead is None
    assert any("crosshead" in note for note in e.provenance["notes"])


def spoiled(folder: Path, frame: int, rows, columns) -> None:
    moved = motion(1 + 0.01 * frame).reshape(ROWS, COLUMNS, 2)
    moved[rows, columns] = np.nan
    write(folder / f"Sheet{frame + 1:04d}.csv", frame_text(moved.reshape(-1, 2)))


def test_a_picture_in_which_a_grip_failed_is_left_out(folder):
    spoiled(folder, 7, 2, 5)
    e = sheet(folder)
    assert e.provenance["frames"] == [1, 2, 3, 4, 5, 6, 8, 9, 10, 11]
    assert e.provenance["points_lost"] == 0
    assert any("frame 7." in note and "10 are kept" in note for note in e.provenance["notes"])


def test_pictures_whose_failures_add_up_are_left_out_those_with_most_first(folder):
    """Of 160 points 24 fail in one picture and 16 others in another: together more than can be bridged."""
    spoiled(folder, 4, slice(4, 7), slice(4, 12))
    spoiled(folder, 8, slice(8, 10), slice(4, 12))
    e = sheet(folder, edge_columns="keep")
    assert 4 not in e.provenance["frames"] and 8 in e.provenance["frames"]
    assert e.provenance["points_lost"] == 16
    assert any("frame 4." in note for note in e.provenance["notes"])


@pytest.mark.parametrize(("words", "expected"), [((), 11), (("--frames", "all"), 11), (("--frames", "5"), 5)])
def test_command_keeps_all_or_how_many(monkeypatch, tmp_path, capsys, words, expected):
    monkeypatch.setenv("EQUIGAP_DEBUG", "1")
    source = packed(tmp_path / "s.npz")
    assert cli.main(["import", str(source), "--scale", str(SCALE), *words, "-o", str(tmp_path / "out")]) == 0
    assert Experiment.load(tmp_path / "out" / "experiment.npz").n_increments == expected
    assert "machine record: 101 readings" in capsys.readouterr().out
