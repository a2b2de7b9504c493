"""Bad measured sheets: each is refused, or mended, with a message that says where and what to do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sheets import (
    COLUMNS,
    NOISE,
    PITCH,
    ROWS,
    SCALE,
    force,
    frame_text,
    motion,
    pixels,
    record_text,
    sheet,
    write,
    write_frames,
)

from calibrate import errors
from calibrate.data.triangulation import signed_areas
from studies.importers import printed_sheets
from studies.importers.recording import synchronise
from studies.importers.recording.series import to_experiment
from studies.importers.recording.synchronise import ForceRecord, Selection


@pytest.fixture
def folder(tmp_path) -> Path:
    """Frames and machine record of a small sheet."""
    return write_frames(tmp_path)


def test_truncated_frame_names_file_and_line(folder):
    path = folder / "Sheet0004.csv"
    path.write_text(path.read_text()[:1000].rsplit(";", 1)[0])
    with pytest.raises(errors.FileFormatError, match=r"Sheet0004.csv, line \d+: \d fields"):
        printed_sheets.read_frames(folder)


def test_non_numeric_and_decimal_commas_in_a_frame(folder):
    path = folder / "Sheet0004.csv"
    lines = path.read_text().splitlines()
    write(path, "\n".join([*lines[:7], lines[7].replace(";0", ";?", 1).replace(lines[7].split(";")[2], "?", 1)]))
    with pytest.raises(errors.FileFormatError, match="Sheet0004.csv, line 8"):
        printed_sheets.read_frames(folder)
    write(path, "\n".join(line.replace(".", ",") for line in lines))
    with pytest.raises(errors.DecimalCommaError, match=r"Sheet0004.csv, line \d+"):
        printed_sheets.read_frames(folder)


def test_decimal_commas_in_the_record(folder):
    write(folder / "force_disp.txt", record_text().replace(".", ","))
    with pytest.raises(errors.DecimalCommaError, match=r"force_disp.txt, line 3"):
        sheet(folder)


@pytest.mark.parametrize("how", ["nan", "blank", "row missing"])
def test_failed_points_are_masked(folder, how):
    path = folder / "Sheet0006.csv"
    lines = path.read_text().splitlines()
    k = 1 + 6 * COLUMNS + 7
    x, y, *_ = lines[k].split(";")
    lines[k] = {"nan": f"{x};{y};NaN;NaN;0", "blank": f"{x};{y};;;", "row missing": ""}[how]
    write(path, "\n".join(lines))
    e = sheet(folder, Selection(frames=(2, 5, 9)))
    assert e.provenance["points_lost"] == 1
    assert len(e.points) == COLUMNS * (ROWS - 4) - 1
    assert signed_areas(e.points, e.triangles).sum() == pytest.approx((COLUMNS - 1) * (ROWS - 5))
    assert any("left out" in note for note in e.provenance["notes"])
    assert sheet(folder, Selection(frames=(2, 9))).provenance["points_lost"] == 0


def test_too_many_failed_points_are_refused(folder):
    moved = motion(1.05).reshape(ROWS, COLUMNS, 2)
    moved[4:9, 5:13] = np.nan
    write(folder / "Sheet0006.csv", frame_text(moved.reshape(-1, 2)))
    with pytest.raises(errors.LostPointsError, match="40 of 160"):
        sheet(folder, Selection(frames=(5,)), edge_columns="keep")


def test_failed_points_on_a_loaded_edge_are_refused(folder):
    moved = motion(1.05).reshape(ROWS, COLUMNS, 2)
    moved[2, 5] = np.nan
    write(folder / "Sheet0006.csv", frame_text(moved.reshape(-1, 2)))
    with pytest.raises(errors.LostPointsError, match="'top'"):
        sheet(folder, Selection(frames=(5,)))


def test_points_that_fold_over_are_refused(folder):
    moved = motion(1.05).reshape(ROWS, COLUMNS, 2)
    moved[6, 6] += [3 * PITCH, 0]
    write(folder / "Sheet0006.csv", frame_text(moved.reshape(-1, 2)))
    with pytest.raises(errors.InvalidDeformationError):
        sheet(folder, Selection(frames=(5,)))


def test_grid_that_does_not_match(folder):
    write(folder / "Sheet0006.csv", frame_text(motion(1.05), pixels() + 3))
    with pytest.raises(errors.MeshMismatchError, match="Sheet0006.csv"):
        printed_sheets.read_frames(folder)


def test_reference_with_holes_in_the_grid_or_points_twice(folder):
    lines = (folder / "Sheet0001.csv").read_text().splitlines()
    write(folder / "Sheet0001.csv", "\n".join([*lines, lines[5]]))
    with pytest.raises(errors.DegenerateMeshError, match="twice"):
        printed_sheets.read_frames(folder)
    for path in folder.glob("*.csv"):
        write(path, "\n".join(line for k, line in enumerate(path.read_text().splitlines()[:224]) if k != 5))
    with pytest.raises(errors.MeshMismatchError, match="16 x 14"):
        sheet(folder)


def test_no_frames_and_no_record(tmp_path, folder):
    with pytest.raises(errors.DataNotFoundError, match="0 frames"):
        printed_sheets.read_frames(tmp_path)
    with pytest.raises(errors.DataNotFoundError, match="nothing.csv"):
        printed_sheets.read_record(folder / "nothing.csv")


def test_time_of_the_record_must_increase(folder):
    write(folder / "force_disp.txt", record_text([0.0, 1.0, 0.5, 2.0]))
    with pytest.raises(errors.TimeError, match="force_disp.txt.*reading 3"):
        sheet(folder)


def test_missing_force():
    with pytest.raises(errors.MissingForceError, match="no force"):
        ForceRecord(np.arange(4.0), np.full(4, np.nan))
    with pytest.raises(errors.MissingForceError, match="two"):
        ForceRecord(np.zeros(1), np.zeros(1))


def test_record_that_does_not_reach_the_frames(folder):
    with pytest.raises(errors.MissingForceError, match="no frame"):
        sheet(folder, offset=100.0)
    with pytest.raises(errors.MissingForceError, match="frame 11 at 11.00 s"):
        sheet(folder, Selection(frames=(2, 11)), frame_rate=1.0)


def test_tension_recorded_as_negative_is_refused(folder):
    times = np.linspace(0, 10, 101)
    text = "Time,Displacement,Force\n(s),(mm),(N)\n" + "\n".join(f"{t:.4f},0,{-force(t):.4f}" for t in times)
    write(folder / "force_disp.txt", text)
    with pytest.raises(errors.ForceSignError):
        sheet(folder)


def test_a_force_of_the_wrong_sign_in_a_few_pictures_is_named(folder):
    """The sum over all pictures is that of tension."""
    times = np.linspace(0, 10, 101)
    signs = np.where((times > 5.5) & (times < 6.5), -1.0, 1.0)
    rows = (f"{t:.4f},0,{s * force(t):.4f}" for t, s in zip(times, signs, strict=True))
    write(folder / "force_disp.txt", "Time,Displacement,Force\n(s),(mm),(N)\n" + "\n".join(rows))
    with pytest.raises(errors.ForceSignError, match=r"force_disp.txt: the force of picture \d+.* far below zero"):
        sheet(folder, frame_rate=1.0)


@pytest.mark.parametrize("scale", [50.0, 1e-5])
def test_implausible_scale(folder, scale):
    with pytest.raises(errors.UnitsError, match="points"):
        sheet(folder, scale=scale)


def test_failure_is_found_and_left_out():
    time = np.linspace(0, 10, 201)
    load = np.where(time < 8, 5 * time, 0.3)
    assert synchronise.find_break(ForceRecord(time, load)) == (pytest.approx(7.95), pytest.approx(8.0))
    p, moved = pixels(), np.stack([motion(1 + 0.02 * t) for t in np.arange(0, 10, 0.5)])
    frames = printed_sheets.Frames(p, moved, 2.0)
    options = printed_sheets.SheetOptions(scale=SCALE)
    e = to_experiment(printed_sheets.sheet_series(frames, ForceRecord(time, load), options), noise=NOISE)
    assert e.time.max() == 7.5
    assert "failure" in e.provenance["notes"][0]


def test_unloading_and_relaxation_are_no_failure():
    time = np.linspace(0, 10, 201)
    cycle = ForceRecord(time, 10 * np.abs(np.sin(time)))
    relaxing = ForceRecord(time, np.where(time < 2, 10 * time, 20 * (0.3 + 0.7 * np.exp(-(time - 2)))))
    assert synchronise.find_break(cycle) is None
    assert synchronise.find_break(relaxing) is None
    # a fast return of the grips
    fast = ForceRecord(time, np.where(time < 9.5, time, np.maximum(9.5 - 20 * (time - 9.5), 0)))
    assert synchronise.find_break(fast) is not None
    stretch = np.interp(np.arange(0, 10.5, 0.5), [0, 9.5, 10], [1.0, 1.19, 1.0])
    frames = printed_sheets.Frames(pixels(), np.stack([motion(s) for s in stretch]), 2.0)
    series = printed_sheets.sheet_series(frames, fast, printed_sheets.SheetOptions(scale=SCALE))
    e = to_experiment(series, Selection(count=12), NOISE)
    (note,) = e.provenance["notes"]
    assert "longest in frame 19" in note
    assert e.time.max() == 10.0
    assert not to_experiment(series, noise=NOISE).provenance["notes"]  # every frame, the longest among them
