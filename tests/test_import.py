"""Import of measured data: readers, synchronisation, bad input, the command."""

from __future__ import annotations

import argparse
import hashlib
import os
from pathlib import Path

import numpy as np
import pytest

from calibrate import errors
from calibrate.experiment import Experiment, Noise, signed_areas
from studies import column_import, column_map, data, dic_csv, importing, synchronise
from studies.series import to_experiment
from studies.synchronise import ForceRecord, Selection
from studies.tables import Layout, read_table

NOISE = Noise(1e-3)
DATA = os.environ.get("EQUIGAP_DATA")
needs_data = pytest.mark.skipif(
    not DATA or not Path(DATA, "printed_elastomer_dic").is_dir(),
    reason="EQUIGAP_DATA names no folder with printed_elastomer_dic",
)


# tables -----------------------------------------------------------------------------------------------------------


def write(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding=encoding)
    return path


def test_table_by_names_with_units_comments_and_quotes(tmp_path):
    text = '# made by hand\n"Time","Force (N)"\r\n(s),(N)\r\n"0.5","1.25"\r\n\r\n"1.0","2.5e0"\r\n'
    path = write(tmp_path / "t.csv", text)
    table = read_table(path, ["Force (N)"], Layout(units_row=True, comment="#"))
    assert table["Force (N)"].tolist() == [1.25, 2.5]


def test_table_without_header_blank_separated(tmp_path):
    table = read_table(write(tmp_path / "t.txt", "  0.1   1.0\n 0.2  1.5\n"), None, Layout(" ", header_line=0))
    assert table["1"].tolist() == [0.1, 0.2]
    assert table["2"].tolist() == [1.0, 1.5]


def test_table_in_latin_1(tmp_path):
    path = write(tmp_path / "t.csv", "Weg [µm];Kraft\n1;2\n", "latin-1")
    assert read_table(path, None, Layout(";"))["Weg [µm]"].tolist() == [1.0]


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        (
            "a;b\n1;2\n3\n",
            errors.FileFormatError,
            "line 3: 1 fields where the header has 2; is the file truncated",
        ),
        ("a;b\n1;2\n3;\n", errors.FileFormatError, "line 3: no value in 'b'"),
        ("a;b\n1;2\n\n3;x7\n", errors.FileFormatError, "line 4: 'x7' in 'b' is not a number"),
        ("a;b\n1;2\n3;4;5\n", errors.FileFormatError, "line 3: 3 fields"),
        ("a;b\n1;0,5\n", errors.DecimalCommaError, "line 2: '0,5' in 'b' has a decimal comma"),
        ("a;b\n1;inf\n", errors.FileFormatError, "line 2: 'b' is not a finite number"),
        ("a;b\n", errors.FileFormatError, "no rows of numbers"),
        ("", errors.FileFormatError, "empty or truncated"),
        ("a;c\n1;2\n", errors.FileFormatError, "0 columns named 'b'"),
        ("a,b\n1,2\n", errors.FileFormatError, "is the delimiter right"),
    ],
)
def test_bad_tables_name_file_and_line(tmp_path, text, kind, message):
    path = write(tmp_path / "bad.csv", text)
    with pytest.raises(kind, match=message) as caught:
        read_table(path, ["a", "b"], Layout(";"))
    assert "bad.csv" in str(caught.value)


def test_decimal_commas_between_commas(tmp_path):
    with pytest.raises(errors.DecimalCommaError, match="line 2"):
        read_table(write(tmp_path / "t.csv", "a,b\n0,5,1,25\n"), ["a", "b"])
    with pytest.raises(errors.DecimalCommaError, match="line 2"):
        read_table(write(tmp_path / "t.csv", 'a,b\n"0,5","1,25"\n'), ["a", "b"])


def test_missing_values_where_allowed(tmp_path):
    table = read_table(write(tmp_path / "t.csv", "a,b\n1,NaN\n2,\n"), None, Layout(missing_allowed=True))
    assert np.isnan(table["b"]).all()
    with pytest.raises(errors.DataNotFoundError, match="no such file"):
        read_table(tmp_path / "nothing.csv")


# a small sheet in the format of the printed elastomer sheets ------------------------------------------------------

COLUMNS, ROWS, PITCH, SCALE = 16, 14, 20, 0.05
HEADER = "x [pixel];y [pixel];x-displacement [pixel];y-displacement [pixel];Displacement [pixel]"


def pixels():
    y, x = np.meshgrid(100 + PITCH * np.arange(ROWS), 200 + PITCH * np.arange(COLUMNS), indexing="ij")
    return np.stack([x.ravel(), y.ravel()], axis=1).astype(float)


def motion(stretch: float):
    """Displacement in pixels, image coordinates: the lower grip rests, the upper one moves up (y falls)."""
    p = pixels()
    x, y = p[:, 0] - p[:, 0].mean(), p[:, 1] - p[:, 1].max()
    return np.stack([(stretch**-0.5 - 1) * x, (stretch - 1) * y], axis=1)


def frame_text(moved, points=None) -> str:
    rows = [
        f"{x:g};{y:g};{u:.6g};{v:.6g};0"
        for (x, y), (u, v) in zip(pixels() if points is None else points, moved, strict=False)
    ]
    return "\n".join([HEADER, *rows]) + "\n"


def force(time):
    return 0.1 + 2.0 * np.asarray(time)


def record_text(times=np.linspace(0, 10, 101)) -> str:
    rows = [f'"{t:.4f}","{0.4 * t:.4f}","{force(t):.4f}"' for t in times]
    return "Time,Displacement,Force\r\n(s),(mm),(N)\r\n" + "\r\n".join(rows) + "\r\n"


@pytest.fixture
def folder(tmp_path) -> Path:
    """Frames every half second: stretch 1 + 0.02 t; 12 frames."""
    for k in range(12):
        write(tmp_path / "sheet" / f"Sheet{k + 1:04d}.csv", frame_text(motion(1 + 0.02 * 0.5 * k)))
    write(tmp_path / "sheet" / "force_disp.txt", record_text())
    return tmp_path / "sheet"


def sheet(folder: Path, selection=Selection(), noise=NOISE, **options) -> Experiment:
    frames = dic_csv.read_frames(folder)
    record = dic_csv.read_record(folder / "force_disp.txt")
    chosen = dic_csv.SheetOptions(**{"scale": SCALE, "frame_rate": 2.0, **options})
    return to_experiment(dic_csv.sheet_series(frames, record, chosen), selection, noise)


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
    assert e.provenance["frames"] == [2, 10]
    untared = sheet(folder, Selection(frames=(2, 10), tare=0.0))
    np.testing.assert_allclose(untared.loaded[1].force[:, 1], [2.1, 10.1], atol=1e-9)


def test_synchronisation_by_rate_and_offset(folder):
    e = sheet(folder, Selection(frames=(4,), tare=0.0), frame_rate=4.0, offset=0.3)
    assert e.time.tolist() == [pytest.approx(1.3)]
    assert e.loaded[1].force[0, 1] == pytest.approx(force(1.3), abs=1e-4)


def test_frames_spread_over_the_loading(folder):
    assert sheet(folder, Selection(count=5)).provenance["frames"] == [3, 5, 7, 9, 11]
    assert sheet(folder, Selection(count=3, until=3.0)).time.tolist() == [1.5, 2.0, 3.0]
    assert sheet(folder, Selection(count=100)).provenance["frames"] == list(range(1, 12))


@pytest.mark.parametrize("frames", [(0, 3), (3, 2), (3, 12), ()])
def test_impossible_frames(folder, frames):
    with pytest.raises(errors.ConfigError, match="give increasing numbers from 1 to 11"):
        sheet(folder, Selection(frames=frames))


def test_edge_columns_and_free_edges(folder):
    full = sheet(folder)
    assert full.free_nodes.size == 2 * (ROWS - 4 - 2)
    assert full.provenance["unmeasured_strip_mm"] == 0
    dropped = sheet(folder, edge_columns="drop")
    assert np.ptp(dropped.points[:, 0]) == pytest.approx(COLUMNS - 5)
    assert dropped.provenance["unmeasured_strip_mm"] == pytest.approx(2.0)
    assert sheet(folder, free_edges="no").free_nodes.size == 0
    with pytest.raises(errors.ConfigError, match="edge_columns 'guess'"):
        sheet(folder, edge_columns="guess")
    with pytest.raises(errors.ConfigError, match="leaves too little"):
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
    frames = dic_csv.Frames(pixels(), shown, 2.0)
    record = ForceRecord(np.linspace(0, 6, 61), force(np.linspace(0, 6, 61)))
    series = dic_csv.sheet_series(frames, record, dic_csv.SheetOptions(scale=SCALE, edge_columns="keep"))
    e = to_experiment(series, Selection(count=4))
    assert e.noise.displacement_std == pytest.approx(0.1 * SCALE, rel=0.15)
    assert e.noise.correlation_length < 0.5
    assert e.provenance["noise"]["from_frames"] == 12
    # half a second between frames and 2 N/s: the unknown start of the sequence outweighs the load cell
    assert e.noise.force_std == pytest.approx(2.0 * 0.5 / np.sqrt(12), rel=0.05)
    with pytest.raises(errors.ConfigError, match="noise kind"):
        to_experiment(series, noise_kind="both")


# bad sheets -------------------------------------------------------------------------------------------------------


def test_truncated_frame_names_file_and_line(folder):
    path = folder / "Sheet0004.csv"
    path.write_text(path.read_text()[:1000].rsplit(";", 1)[0])
    with pytest.raises(errors.FileFormatError, match=r"Sheet0004.csv, line \d+: \d fields where the header has 5"):
        dic_csv.read_frames(folder)


def test_non_numeric_and_decimal_commas_in_a_frame(folder):
    path = folder / "Sheet0004.csv"
    lines = path.read_text().splitlines()
    write(path, "\n".join([*lines[:7], lines[7].replace(";0", ";?", 1).replace(lines[7].split(";")[2], "?", 1)]))
    with pytest.raises(errors.FileFormatError, match=r"Sheet0004.csv, line 8: .* is not a number"):
        dic_csv.read_frames(folder)
    write(path, "\n".join(line.replace(".", ",") for line in lines))
    with pytest.raises(errors.DecimalCommaError, match=r"Sheet0004.csv, line \d+: .* decimal comma"):
        dic_csv.read_frames(folder)


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
    with pytest.raises(errors.LostPointsError, match="40 of 160 points failed"):
        sheet(folder, Selection(frames=(5,)), edge_columns="keep")


def test_failed_points_on_a_loaded_edge_are_refused(folder):
    moved = motion(1.05).reshape(ROWS, COLUMNS, 2)
    moved[2, 5] = np.nan
    write(folder / "Sheet0006.csv", frame_text(moved.reshape(-1, 2)))
    with pytest.raises(errors.LostPointsError, match="loaded edge 'top'"):
        sheet(folder, Selection(frames=(5,)))


def test_points_that_fold_over_are_refused(folder):
    moved = motion(1.05).reshape(ROWS, COLUMNS, 2)
    moved[6, 6] += [3 * PITCH, 0]
    write(folder / "Sheet0006.csv", frame_text(moved.reshape(-1, 2)))
    with pytest.raises(errors.InvalidDeformationError, match="det F <= 0"):
        sheet(folder, Selection(frames=(5,)))


def test_grid_that_does_not_match(folder):
    write(folder / "Sheet0006.csv", frame_text(motion(1.05), pixels() + 3))
    with pytest.raises(errors.MeshMismatchError, match=r"Sheet0006.csv: point .* is not in the first frame"):
        dic_csv.read_frames(folder)


def test_reference_with_holes_in_the_grid_or_points_twice(folder):
    lines = (folder / "Sheet0001.csv").read_text().splitlines()
    write(folder / "Sheet0001.csv", "\n".join([*lines, lines[5]]))
    with pytest.raises(errors.DegenerateMeshError, match="listed twice"):
        dic_csv.read_frames(folder)
    for path in folder.glob("*.csv"):
        write(path, "\n".join(line for k, line in enumerate(path.read_text().splitlines()[:224]) if k != 5))
    with pytest.raises(errors.MeshMismatchError, match="no full grid of 16 x 14"):
        sheet(folder)


def test_no_frames_and_no_record(tmp_path, folder):
    with pytest.raises(errors.DataNotFoundError, match="0 frames"):
        dic_csv.read_frames(tmp_path)
    with pytest.raises(errors.DataNotFoundError, match="no such file"):
        dic_csv.read_record(folder / "nothing.csv")


def test_time_of_the_record_must_increase(folder):
    write(folder / "force_disp.txt", record_text([0.0, 1.0, 0.5, 2.0]))
    with pytest.raises(errors.TimeError, match=r"force_disp.txt: time does not increase at reading 3"):
        sheet(folder)


def test_missing_force():
    with pytest.raises(errors.MissingForceError, match="contains no force"):
        ForceRecord(np.arange(4.0), np.full(4, np.nan))
    with pytest.raises(errors.MissingForceError, match="at least two readings"):
        ForceRecord(np.zeros(1), np.zeros(1))


def test_record_that_does_not_reach_the_frames(folder):
    with pytest.raises(errors.MissingForceError, match="no frame has a force"):
        sheet(folder, offset=100.0)
    with pytest.raises(errors.MissingForceError, match=r"frame 11 at 11.00 s has no force"):
        sheet(folder, Selection(frames=(2, 11)), frame_rate=1.0)


def test_tension_recorded_as_negative_is_refused(folder):
    times = np.linspace(0, 10, 101)
    text = "Time,Displacement,Force\n(s),(mm),(N)\n" + "\n".join(f"{t:.4f},0,{-force(t):.4f}" for t in times)
    write(folder / "force_disp.txt", text)
    with pytest.raises(errors.ForceSignError, match="positive in tension"):
        sheet(folder)


@pytest.mark.parametrize(
    ("options", "message"),
    [({"scale": 50.0}, "points must be in mm"), ({"scale": 1e-5}, "points must be in mm")],
)
def test_implausible_scale(folder, options, message):
    with pytest.raises(errors.UnitsError, match=message):
        sheet(folder, **options)


# a specimen that breaks -------------------------------------------------------------------------------------------


def test_failure_is_found_and_left_out():
    time = np.linspace(0, 10, 201)
    load = np.where(time < 8, 5 * time, 0.3)
    assert synchronise.find_break(ForceRecord(time, load)) == (pytest.approx(7.95), pytest.approx(8.0))
    p, moved = pixels(), np.stack([motion(1 + 0.02 * t) for t in np.arange(0, 10, 0.5)])
    frames = dic_csv.Frames(p, moved, 2.0)
    options = dic_csv.SheetOptions(scale=SCALE)
    e = to_experiment(dic_csv.sheet_series(frames, ForceRecord(time, load), options), noise=NOISE)
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
    frames = dic_csv.Frames(pixels(), np.stack([motion(s) for s in stretch]), 2.0)
    e = to_experiment(dic_csv.sheet_series(frames, fast, dic_csv.SheetOptions(scale=SCALE)), noise=NOISE)
    assert e.provenance["notes"] == []
    assert e.time.max() == 10.0


# the packed form and the published sheets -------------------------------------------------------------------------


def packed(path: Path, **changes) -> Path:
    u = np.stack([motion(1 + 0.01 * k) for k in range(12)]).astype(np.float32)
    p, t = pixels().astype(np.float32), np.linspace(0, 10, 101)
    arrays = {
        "x_px": p[:, 0],
        "y_px": p[:, 1],
        "ux_px": u[..., 0],
        "uy_px": u[..., 1],
        "time_s": t,
        "force_N": force(t),
    }
    arrays = {**arrays, "frame_rate_hz": np.array(2.0), **changes}
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})
    return path


def test_packed_and_folder_agree(tmp_path, folder):
    frames, record = dic_csv.read_packed(packed(tmp_path / "sheet.npz"))
    again = dic_csv.read_frames(folder)
    np.testing.assert_array_equal(frames.points, again.points)
    np.testing.assert_allclose(frames.displacements, again.displacements, atol=2e-4)
    assert frames.frame_rate == 2.0
    assert record.force[0] == pytest.approx(0.1)


def test_bad_packed_files(tmp_path):
    with pytest.raises(errors.FileFormatError, match="'uy_px' is missing"):
        dic_csv.read_packed(packed(tmp_path / "a.npz", uy_px=None))
    with pytest.raises(errors.MeshMismatchError, match="223 points"):
        dic_csv.read_packed(packed(tmp_path / "a.npz", x_px=np.zeros(223), y_px=np.zeros(223)))
    write(tmp_path / "b.npz", "text")
    with pytest.raises(errors.FileFormatError, match="not a readable"):
        dic_csv.read_packed(tmp_path / "b.npz")


@needs_data
def test_published_frames_match_the_packed_sheet():
    root = Path(str(DATA), "printed_elastomer_dic")
    frames, _ = dic_csv.read_packed(root / "Soft_Homo.npz")
    files = dic_csv.frame_files(root / "raw_sample")
    assert [p.name[-8:-4] for p in files] == ["0001", "0100", "0189"]
    for path in files:
        raw = dic_csv.read_frame(path).astype(np.float32)
        np.testing.assert_array_equal(raw[:, :2], frames.points)
        np.testing.assert_array_equal(raw[:, 2:], frames.displacements[int(path.name[-8:-4]) - 1])


@needs_data
@pytest.mark.parametrize("name", list(data.SHEETS))
def test_published_sheets(name):
    root = Path(str(DATA), "printed_elastomer_dic")
    frames, record = dic_csv.read_packed(data.sheet(name))
    u = frames.displacements.astype(np.float32)
    assert (len(u), data.displacement_digest(u)) == (
        data.SHEETS[name].frames,
        data.SHEETS[name].displacements,
    )
    again = dic_csv.read_record(root / f"{name}_force_disp.csv")
    assert dic_csv.sha256(root / f"{name}_force_disp.csv") == data.SHEETS[name].record
    np.testing.assert_array_equal(again.force, record.force)
    e = importing.import_experiment(name)
    assert e.n_increments == 12
    assert e.thickness is None
    np.testing.assert_allclose(np.ptp(e.points, axis=0), [41.73, 36.76], atol=0.01)
    top, bottom = e.displacements[-1, e.loaded[1].nodes, 1], e.displacements[-1, e.loaded[0].nodes, 1]
    assert top.mean() > 10
    assert 0 < bottom.mean() < 0.1 * top.mean()
    assert (np.diff(e.loaded[1].force[:, 1]) > 0).all()
    assert e.loaded[1].force[-1, 1] > 15
    # between what changes from frame to frame (0.5 um) and 1 % of the largest displacement
    assert 0.005 < e.noise.displacement_std < 0.02
    assert 0.5 < e.noise.correlation_length < 1.0
    assert 4e-4 < e.provenance["noise"]["temporal"]["std"] < 8e-4


# finding data -----------------------------------------------------------------------------------------------------


@pytest.fixture
def nowhere(tmp_path, monkeypatch) -> Path:
    """No EQUIGAP_DATA, an empty cache."""
    monkeypatch.delenv(data.VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path


def offline(address: str) -> bytes:
    raise OSError("no network")


def test_data_folder_wins(nowhere, monkeypatch):
    write(nowhere / "mine" / "a" / "b.csv", "x")
    monkeypatch.setenv(data.VARIABLE, str(nowhere / "mine"))
    assert data.find("a/b.csv", offline) == nowhere / "mine" / "a" / "b.csv"
    monkeypatch.setenv(data.VARIABLE, str(nowhere / "nothing"))
    with pytest.raises(errors.DataNotFoundError, match=r"names .*nothing, which is no folder"):
        data.find("a/b.csv")


def test_absent_data_say_what_to_put_where(nowhere):
    relative = next(iter(data.FILES))
    with pytest.raises(errors.DataNotFoundError, match=r"treloar_0.csv not found .*no network.*set EQUIGAP_DATA"):
        data.find(relative, offline)
    with pytest.raises(errors.DataNotFoundError, match="no public source in this form"):
        data.find("kawabata_jl/kawabata1981_biaxial.csv", offline)
    with pytest.raises(errors.DataNotFoundError, match=r"Soft_Homo.npz not found .*fetching its frames"):
        data.sheet("Soft_Homo", offline)
    with pytest.raises(errors.ConfigError, match="sheet 'Soft' unknown"):
        data.sheet("Soft")


def test_fetched_file_is_checked_and_kept(nowhere, monkeypatch):
    content, relative = b"1.0, 0.0\n", "some/file.csv"
    address = ("https://example.org/file.csv", hashlib.sha256(content).hexdigest())
    monkeypatch.setitem(data.FILES, relative, address)
    with pytest.raises(errors.DataNotFoundError, match="has changed"):
        data.find(relative, lambda a: b"something else")
    assert not list((nowhere / "cache").rglob("*.csv"))
    assert data.find(relative, lambda a: content).read_bytes() == content
    assert data.find(relative, offline) == nowhere / "cache" / "equigap" / relative


def test_fetched_sheet_is_packed_and_checked(nowhere, folder, monkeypatch):
    record = (folder / "force_disp.txt").read_bytes()
    frames = dic_csv.read_frames(folder)
    digest = data.displacement_digest(frames.displacements.astype(np.float32))
    monkeypatch.setitem(data.SHEETS, "Sheet", data.Sheet(12, digest, hashlib.sha256(record).hexdigest()))

    def served(address: str) -> bytes:
        name = address.rsplit("/", 1)[1].replace("Sheet_Final", "Sheet")
        return record if name == "force_disp.csv" else (folder / name).read_bytes()

    again, kept = dic_csv.read_packed(data.sheet("Sheet", served))
    np.testing.assert_allclose(again.displacements, frames.displacements, atol=1e-5)
    assert kept.force[0] == pytest.approx(0.1)
    assert data.sheet("Sheet", offline).is_file()
    monkeypatch.setitem(data.SHEETS, "Sheet2", data.Sheet(12, "0", "0"))
    with pytest.raises(errors.DataNotFoundError, match="checksums differ"):
        data.sheet("Sheet2", lambda a: served(a.replace("Sheet2", "Sheet")))


# column maps ------------------------------------------------------------------------------------------------------

MAP = """
name = "mapped"
thickness_mm = 2.0
[points]
files = "frames/f*.csv"
x = "X"
y = "Y"
u = "U"
v = "V"
unit = "px"
scale_mm_per_px = 0.05
y_axis = "down"
valid_column = "sigma"
valid_minimum = 0.0
[force]
file = "load.csv"
time = "t"
force = "F"
unit = "kN"
sign = -1.0
[frames]
rate_hz = 2.0
count = 4
tare_N = 0.0
[edges]
loaded = ["bottom", "top"]
free = ["left", "right", "holes"]
[noise]
displacement_std_mm = 0.001
"""


def mapped(tmp_path: Path, text: str = MAP, keep=lambda p: np.ones(len(p), bool), coordinates="reference") -> Path:
    p = pixels()
    chosen = np.random.default_rng(0).permutation(np.flatnonzero(keep(p)))
    for k in range(12):
        u = motion(1 + 0.01 * k)
        shown = p + u if coordinates == "current" else p
        lines = [f"{i},{shown[i, 0]:.6f},{shown[i, 1]:.6f},{u[i, 0]:.6f},{u[i, 1]:.6f},0.01" for i in chosen]
        write(tmp_path / "frames" / f"f_{k}.csv", "n,X,Y,U,V,sigma\n" + "\n".join(lines) + "\n")
    times = np.linspace(0, 10, 101)
    write(tmp_path / "load.csv", "t,F\n" + "\n".join(f"{t:.3f},{-1e-3 * force(t):.7f}" for t in times))
    return write(tmp_path / "map.toml", text)


def from_map(path: Path) -> Experiment:
    m = column_map.read_map(path)
    return to_experiment(column_import.column_series(m, path.parent), m.selection, m.stated_noise)


@pytest.mark.parametrize("coordinates", ["reference", "current"])
def test_column_map(tmp_path, coordinates):
    text = MAP.replace('y_axis = "down"', f'y_axis = "down"\ncoordinates = "{coordinates}"')
    e = from_map(mapped(tmp_path, text, coordinates=coordinates))
    assert e.name == "mapped"
    assert e.stress_unit == "MPa"
    assert len(e.points) == COLUMNS * ROWS
    np.testing.assert_allclose(np.ptp(e.points, axis=0), [15.0, 13.0], atol=1e-6)
    assert signed_areas(e.points, e.triangles).sum() == pytest.approx(15 * 13)
    names = {b.name: b for b in e.loaded}
    assert len(names["top"].nodes) == COLUMNS
    assert (names["top"].force[:, 1] > 0).all()
    assert names["bottom"].force[-1, 1] == pytest.approx(-force(e.time[-1]), rel=1e-5)
    assert e.free_nodes.size == 2 * (ROWS - 2)
    slope = np.polyfit(e.points[:, 1], e.displacements[-1, :, 1], 1)[0]
    assert slope == pytest.approx(0.01 * 2 * e.time[-1], rel=1e-4)
    assert e.noise == Noise(0.001)


def test_column_map_keeps_holes_and_finds_their_rims(tmp_path):
    def outside(p):
        centre = [200 + 7.5 * PITCH, 100 + 6.5 * PITCH]
        return (np.abs(p - centre) > 1.6 * PITCH).any(axis=1)

    e = from_map(mapped(tmp_path, keep=outside))
    assert len(e.points) == COLUMNS * ROWS - 16
    assert signed_areas(e.points, e.triangles).sum() == pytest.approx(15 * 13 - 25 + 4 * 0.5)  # corners are bridged
    assert e.free_nodes.size == 2 * (ROWS - 2) + 16


def test_column_map_drops_invalid_points(tmp_path):
    path = mapped(tmp_path)
    frame = tmp_path / "frames" / "f_8.csv"
    lines = frame.read_text().splitlines()
    inner = next(k for k, line in enumerate(lines) if line.startswith(f"{6 * COLUMNS + 7},"))
    lines[inner] = lines[inner].rsplit(",", 1)[0] + ",-1"
    write(frame, "\n".join(lines))
    text = MAP.replace("count = 4", "list = [3, 8]")
    e = from_map(write(path, text))
    assert e.provenance["points_lost"] == 1
    assert e.provenance["frames"] == [3, 8]


def test_force_per_frame(tmp_path):
    path = mapped(tmp_path)
    write(tmp_path / "load.csv", "F\n" + "\n".join(f"{-1e-3 * k:.4f}" for k in range(12)))
    text = MAP.replace('time = "t"\n', "per_frame = true\n").replace("count = 4", "list = [2, 5]")
    e = from_map(write(path, text))
    np.testing.assert_allclose(e.loaded[1].force[:, 1], [2.0, 5.0], atol=1e-9)
    write(tmp_path / "load.csv", "F\n-1\n-2\n")
    with pytest.raises(errors.MeshMismatchError, match="2 forces for 12 frames"):
        from_map(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('x = "X"', 'x = "X"\nxx = 1', "points: unknown key 'xx'; did you mean 'x'"),
        ("rate_hz", "rate_Hz", "frames: unknown key 'rate_Hz'; did you mean 'rate_hz'"),
        ("[edges]", "[edge]", "unknown key 'edge'; did you mean 'edges'"),
        ('y = "Y"\n', "", "points: key 'y' is missing"),
        ("count = 4", "count = 4.5", "frames: count must be of type int"),
        ("count = 4", "count = true", "frames: count must be of type int"),
        ('free = ["left", "right", "holes"]', 'free = "left"', "edges: free must be a list"),
        ('unit = "kN"', 'unit = "kp"', "force.unit = 'kp' unknown"),
        ('loaded = ["bottom", "top"]', 'loaded = ["bottom", "up"]', "edges.loaded = 'up' unknown"),
        ("scale_mm_per_px = 0.05\n", "", "scale_mm_per_px belongs to unit 'px'"),
        ('loaded = ["bottom", "top"]', 'loaded = ["bottom", "left"]', "a loaded side is not free"),
        ('time = "t"\n', "", "give frames.rate_hz and force.time"),
        ("[noise]", "[noise", "not valid TOML"),
        ("[noise]\ndisplacement_std_mm = 0.001", "noise = 3", "unknown key 'noise'"),
    ],
)
def test_bad_column_maps(tmp_path, old, new, message):
    assert old in MAP
    path = write(tmp_path / "map.toml", MAP.replace(old, new))
    with pytest.raises(errors.ConfigError, match=message):
        column_map.read_map(path)


def test_column_map_and_files_that_do_not_match(tmp_path):
    path = mapped(tmp_path)
    with pytest.raises(errors.DataNotFoundError, match="0 files"):
        from_map(write(path, MAP.replace("f*.csv", "g*.csv")))
    with pytest.raises(errors.FileFormatError, match="columns named 'XX'"):
        from_map(write(path, MAP.replace('"X"', '"XX"')))
    mapped(tmp_path, coordinates="current")
    write(path, MAP)
    far = "\n".join(f"{k},{9e3 + 20 * k},0,1,1,0" for k in range(50))
    write(tmp_path / "frames" / "f_5.csv", "n,X,Y,U,V,sigma\n" + far)
    with pytest.raises(errors.MeshMismatchError, match=r"f_5.csv: .* points.coordinates = 'current'"):
        from_map(path)


def test_column_map_with_duplicate_points(tmp_path):
    path = mapped(tmp_path)
    frame = tmp_path / "frames" / "f_0.csv"
    lines = frame.read_text().splitlines()
    write(frame, "\n".join([*lines, lines[4]]))
    with pytest.raises(errors.DegenerateMeshError, match="listed twice"):
        from_map(path)


def test_sides_that_share_a_corner(tmp_path):
    text = MAP.replace('["bottom", "top"]', '["bottom", "left"]').replace('["left", "right", "holes"]', "[]")
    with pytest.raises(errors.ConfigError, match="share corner nodes"):
        from_map(mapped(tmp_path, text))


@pytest.mark.parametrize("name", ["matchid", "vic", "dice"])
def test_documented_examples_are_valid(name):
    path = Path(__file__).parent.parent / "docs" / "import" / f"{name}.toml"
    assert column_map.read_map(path).name.startswith(name)
    assert "UNCHECKED" in path.read_text()


# the command ------------------------------------------------------------------------------------------------------


def run(*words) -> int:
    parser = argparse.ArgumentParser()
    importing.add_arguments(parser)
    return importing.main(parser.parse_args([str(w) for w in words]))


def test_command_writes_experiment_picture_and_manifest(tmp_path, capsys):
    source = packed(tmp_path / "sheet.npz")
    out = tmp_path / "out"
    assert run(source, "-o", out, "--scale", SCALE, "--frames", "3,6,9") == 0
    e = Experiment.load(out / "experiment.npz")
    assert e.name == "sheet"
    assert e.provenance["frames"] == [3, 6, 9]
    assert {p.name for p in out.iterdir()} == {
        "experiment.npz",
        "experiment.png",
        "experiment.json",
        "run.json",
    }
    said = capsys.readouterr().out
    assert "3 increments" in said
    assert "thickness unknown" in said
    with pytest.raises(Exception, match="other settings"):
        run(source, "-o", out, "--scale", SCALE, "--frames", "5")
    assert run(source, "-o", out, "--scale", SCALE, "--frames", "5", "--overwrite") == 0


def test_command_reads_a_folder_and_a_column_map(tmp_path, folder):
    (folder / "force_disp.txt").rename(tmp_path / "record.csv")
    with pytest.raises(errors.MissingForceError, match="--record"):
        run(folder, "-o", tmp_path / "a")
    words = (
        "--record",
        tmp_path / "record.csv",
        "--scale",
        SCALE,
        "--frame-rate",
        2,
        "--displacement-std",
        0.001,
    )
    assert run(folder, "-o", tmp_path / "a", *words) == 0
    assert Experiment.load(tmp_path / "a" / "experiment.npz").noise == Noise(0.001)
    assert run(mapped(tmp_path / "m"), "-o", tmp_path / "b") == 0
    assert Experiment.load(tmp_path / "b" / "experiment.npz").name == "mapped"


def test_command_refuses_what_it_cannot_read(tmp_path):
    with pytest.raises(errors.DataNotFoundError, match="neither a published sheet"):
        run(tmp_path / "nothing", "-o", tmp_path / "a")
    with pytest.raises(errors.MissingForceError, match="no force record"):
        run(packed(tmp_path / "s.npz", force_N=None), "-o", tmp_path / "a")
    with pytest.raises(errors.ConfigError, match="--frames many"):
        run(packed(tmp_path / "s.npz"), "-o", tmp_path / "a", "--frames", "many")
    with pytest.raises(errors.ConfigError, match="option 'scal' unknown"):
        importing.import_experiment(tmp_path / "s.npz", scal=1)
    assert not (tmp_path / "a").exists()
