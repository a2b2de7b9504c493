"""Printed sheets to an Experiment: units, axes, synchronisation, frames, edges, noise, packed form."""

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

from calibrate import errors
from calibrate.data.triangulation import signed_areas
from studies.importers import printed_sheets
from studies.importers.recording import series
from studies.importers.recording.series import to_experiment
from studies.importers.recording.synchronise import ForceRecord, Selection


@pytest.fixture
def folder(tmp_path) -> Path:
    """Frames and machine record of a small sheet."""
    return write_frames(tmp_path)


def test_sheet_in_mm_with_y_up(folder):
    e = sheet(folder, Selection(frames=(2, 10)))
    np.testing.assert_allclose(np.ptp(e.points, axis=0), [(COLUMNS - 1) * 1.0, (ROWS - 5) * 1.0])
    np.testing.assert_allclose(e.points[:, 0].mean(), 0.0, atol=1e-12)
    assert (signed_areas(e.points, e.triangles) > 0).all()
    bottom, top = e.loaded
    assert e.points[top.nodes, 1].min() > e.points[bottom.nodes, 1].max()
    # stretch 1.1 at t = 5 s: the top has moved up, and the field is homogeneous
    gradient = np.polyfit(e.points[:, 1], e.displacements[1, :, 1], 1)[0]
    assert gradient == pytest.approx(0.1, abs=1e-5)
    assert np.polyfit(e.points[:, 0], e.displacements[1, :, 0], 1)[0] == pytest.approx(1.1**-0.5 - 1, abs=1e-5)
    assert e.time.tolist() == [1.0, 5.0]
    assert e.thickness is None
    assert e.stress_unit == "N/mm"


def test_forces_of_both_grips(folder):
    e = sheet(folder, Selection(frames=(2, 10)))
    bottom, top = e.loaded
    np.testing.assert_allclose(top.force[:, 1], [2.0, 10.0], atol=1e-9)  # less the 0.1 N at frame 0
    np.testing.assert_allclose(bottom.force[:, 1], [-2.0, -10.0], atol=1e-9)
    assert np.isnan(top.force[:, 0]).all()
    assert e.provenance["tare_N"] == pytest.approx(0.1)
    assert e.is_zeroed
    assert e.provenance["frames"] == [2, 10]
    untared = sheet(folder, Selection(frames=(2, 10), tare=0.0))
    np.testing.assert_allclose(untared.loaded[1].force[:, 1], [2.1, 10.1], atol=1e-9)
    assert not untared.is_zeroed  # a force that is stated as zero says nothing of the load cell


def test_a_force_at_the_reference_picture_is_told(folder):
    """From 3 % of the largest force on: more than a load cell that was not zeroed reads."""

    def said(selection, forces):
        frames = printed_sheets.read_frames(folder)
        record = printed_sheets.read_record(folder / "force_disp.txt")
        options = printed_sheets.SheetOptions(scale=SCALE, frame_rate=2.0)
        e = to_experiment(
            printed_sheets.sheet_series(frames, replace(record, force=record.force + forces), options), selection, NOISE
        )
        return [note for note in e.provenance["notes"] if "at the reference picture" in note]

    assert said(Selection(frames=(2, 10)), 0.0) == []
    (note,) = said(Selection(frames=(2, 10)), 2.4)
    assert "2.5 N at the reference picture, 20 % of the largest force" in note and "earlier picture" in note
    assert said(Selection(frames=(2, 10), tare=0.1), 2.4) == []


def test_frames_without_a_force_are_told(folder):
    """The record ends at 10 s, before the last of them at half the rate."""
    frames = printed_sheets.read_frames(folder)
    record = printed_sheets.read_record(folder / "force_disp.txt")
    slow, whole = (
        to_experiment(
            printed_sheets.sheet_series(frames, record, printed_sheets.SheetOptions(scale=SCALE, frame_rate=rate)),
            noise=NOISE,
        )
        for rate in (1.0, 4.0)
    )
    assert not any("without a force" in note for note in whole.provenance["notes"])
    (note,) = (note for note in slow.provenance["notes"] if "without a force" in note)
    assert f"{len(frames.displacements) - 11} frame" in note and "--frame-rate" in note


def test_synchronisation_by_rate_and_offset(folder):
    e = sheet(folder, Selection(frames=(4,), tare=0.0), frame_rate=4.0, offset=0.3)
    assert e.time.tolist() == [
        pytest.approx(1.0)
    ]  # counts from the reference picture, at 0.3 s on the clock of the machine
    assert e.loaded[1].force[0, 1] == pytest.approx(force(1.3), abs=1e-4)
    assert e.provenance["start_s"] == pytest.approx(0.3) and any("begins at 0.3 s" in n for n in e.provenance["notes"])
    assert e.record.time[0] == pytest.approx(-0.3) and e.record.time[-1] > e.time[-1]


def test_frames_spread_over_the_loading(folder):
    assert sheet(folder, Selection(count=5)).provenance["frames"] == [3, 5, 7, 9, 11]
    assert sheet(folder, Selection(count=3, until=3.0)).time.tolist() == [1.5, 2.0, 3.0]
    for count in (11, 100):  # no more than there are: all of them
        assert sheet(folder, Selection(count=count)).provenance["frames"] == list(range(1, 12))


@pytest.mark.parametrize("frames", [(0, 3), (3, 2), (3, 12), ()])
def test_impossible_frames(folder, frames):
    with pytest.raises(errors.ConfigError, match="1 to 11"):
        sheet(folder, Selection(frames=frames))


def test_edge_columns_and_free_edges(folder):
    full = sheet(folder)
    assert full.free_nodes.size == 2 * (ROWS - 4 - 2)
    assert full.provenance["unmeasured_strip_mm"] == 0
    dropped = sheet(folder, edge_columns="drop")
    assert np.ptp(dropped.points[:, 0]) == pytest.approx(COLUMNS - 5)
    assert dropped.provenance["unmeasured_strip_mm"] == pytest.approx(2.0)
    assert sheet(folder, free_edges="no").free_nodes.size == 0
    with pytest.raises(errors.ConfigError, match="'guess'"):
        sheet(folder, edge_columns="guess")
    with pytest.raises(errors.ConfigError):
        sheet(folder, drop_rows=6)


def test_extrapolated_columns_ignore_what_was_measured_there(folder):
    wrong = motion(1.05).reshape(ROWS, COLUMNS, 2)
    wrong[:, [0, 1, -2, -1]] += 7.0
    write(folder / "Sheet0006.csv", frame_text(wrong.reshape(-1, 2)))
    a, b = sheet(folder, Selection(frames=(5,))), sheet(folder, Selection(frames=(5,)), edge_columns="keep")
    expected = motion(1.05).reshape(ROWS, COLUMNS, 2)[2:-2][::-1].reshape(-1, 2) * SCALE * [1, -1]
    np.testing.assert_allclose(a.displacements[0], expected, atol=1e-4)
    assert np.abs(b.displacements[0] - expected).max() == pytest.approx(7.0 * SCALE, rel=1e-3)


def test_noise_is_estimated_from_all_frames(tmp_path):
    rng = np.random.default_rng(0)
    shown = np.stack([motion(1 + 0.01 * k) for k in range(12)])
    shown[1:] += 0.1 * rng.standard_normal((11, *shown.shape[1:]))
    frames = printed_sheets.Frames(pixels(), shown, 2.0)
    record = ForceRecord(np.linspace(0, 6, 61), force(np.linspace(0, 6, 61)))
    series = printed_sheets.sheet_series(frames, record, printed_sheets.SheetOptions(scale=SCALE, edge_columns="keep"))
    e = to_experiment(series, Selection(count=4))
    assert e.noise.displacement_std == pytest.approx(0.1 * SCALE, rel=0.15)
    assert e.noise.correlation_length < 0.5
    assert e.provenance["noise"]["from_frames"] == 12
    # half a second between frames and 2 N/s: the unknown start of the sequence outweighs the load cell
    assert e.noise.force_std == pytest.approx(2.0 * 0.5 / np.sqrt(12), rel=0.05)
    with pytest.raises(errors.ConfigError, match="noise kind"):
        to_experiment(series, noise_kind="both")


def test_packed_and_folder_agree(tmp_path, folder):
    frames, record = printed_sheets.read_packed(packed(tmp_path / "sheet.npz"))
    again = printed_sheets.read_frames(folder)
    np.testing.assert_array_equal(frames.points, again.points)
    np.testing.assert_allclose(frames.displacements, again.displacements, atol=2e-4)
    assert frames.frame_rate == 2.0
    assert record.force[0] == pytest.approx(0.1)


def test_bad_packed_files(tmp_path):
    with pytest.raises(errors.FileFormatError, match="'uy_px' is missing"):
        printed_sheets.read_packed(packed(tmp_path / "a.npz", uy_px=None))
    with pytest.raises(errors.MeshMismatchError, match="223 points"):
        printed_sheets.read_packed(packed(tmp_path / "a.npz", x_px=np.zeros(223), y_px=np.zeros(223)))
    write(tmp_path / "b.npz", "text")
    with pytest.raises(errors.FileFormatError, match="b.npz") as raised:
        printed_sheets.read_packed(tmp_path / "b.npz")
    assert "pickle" not in str(raised.value)


def test_a_peak_between_the_chosen_frames_is_told():
    """Softening and permanent set depend on the largest deformation, chosen or not."""
    lengths = np.concatenate([np.linspace(0, 10, 11), np.linspace(9, 2, 8), np.linspace(3, 6, 4)])
    (note,) = series.unseen_peak(lengths, np.array([4, 8, 12, 16]))
    assert "longest in frame 10, 2 mm longer" in note and "before frame 12" in note
    assert series.unseen_peak(lengths, np.array([4, 8, 10, 12, 16])) == []
    ramp = np.linspace(0, 10, 23) + 0.05 * np.sin(np.arange(23))
    assert series.unseen_peak(ramp, np.array([5, 11, 17, 22])) == []
