"""Exports of the same programs written otherwise: read right, or refused by name; nothing is guessed wrong in silence."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from sheets import write
from vendor_exports import SCALE, STEPS, X, Y, istra4d, matchid, matrices, moved, table, vic2d, vic3d, zeiss

from calibrate import errors
from studies.commands.import_data import Request, read
from studies.importers.exports.picture_rows import rows_of_pictures
from studies.importers.recording.importer import Answers, SheetOptions

PIXELS = SheetOptions(scale=SCALE)
HEAD = "File;TimeStamp; Force [V]; Force [N]"


def lines(function):
    """The function on the list of lines of a file."""
    return lambda path: path.write_text("\n".join(function(path.read_text().splitlines())) + "\n")


def rewritten(export, function):
    """An export whose files were changed one by one."""

    def made(folder: Path) -> None:
        export(folder)
        for path in sorted(folder.iterdir()):
            function(path)

    return made


def recorded(folder: Path, frames: int, head: str = HEAD) -> None:
    rows = [f"{k}.tif;12:0{k}; {k}.0; {2 * k}.0" for k in range(frames)]
    write(folder / "Image.csv", "\n".join([head, *rows]) + "\n")


def failed_at_zero(rows):
    """Three points that were not matched, written as zeros."""
    return [",".join(["0"] * 6 + ["-1"]) if i in (5, 17, 33) else row for i, row in enumerate(rows)]


def where_they_are(rows):
    """Positions after displacement."""
    values = np.array([row.split(",") for row in rows[1:]], float)
    values[:, :3] += values[:, 3:6]
    return [rows[0], *(",".join(f"{v:.9g}" for v in row) for row in values)]


def quoted_commas(rows):
    """Decimal commas in quotes, commas between the columns."""
    return [rows[0], *(",".join(f'"{v}"'.replace(".", ",") for v in row.split(",")) for row in rows[1:])]


def uncalibrated(folder: Path) -> None:
    """Calibrated columns that hold zeros."""
    for k in range(STEPS + 1):
        u, v = moved(k).T / SCALE
        columns = [X / SCALE, 900 - Y / SCALE, u, -v, 0.01 + 0 * X, *([0 * X] * 4)]
        table(folder / f"t-{k:03d}.csv", "x,y,u,v,sigma,x_c,y_c,u_c,v_c", columns)


german = lines(lambda rows: [row.replace(",", ";").replace(".", ",") for row in rows])
commas_below_header = lines(lambda rows: [rows[0]] + [row.replace(".", ",") for row in rows[1:]])


@pytest.mark.parametrize(
    ("export", "sheet", "lost", "entries"),
    [
        (rewritten(vic3d, lines(failed_at_zero)), SheetOptions(), 3, {}),
        (rewritten(vic3d, lines(where_they_are)), SheetOptions(), 0, {"points.coordinates": "current"}),
        (rewritten(vic2d, german), PIXELS, 0, {"points.delimiter": ";", "points.decimal": ","}),
        (rewritten(vic2d, lines(quoted_commas)), PIXELS, 0, {"points.delimiter": ",", "points.decimal": ","}),
        # the first file of which has whole numbers alone
        (rewritten(matchid, commas_below_header), SheetOptions(), 0, {"points.decimal": ","}),
        (uncalibrated, PIXELS, 0, {"points.unit": "px", "points.x": "x"}),
    ],
)
def test_the_same_field_written_otherwise(tmp_path, export, sheet, lost, entries):
    export(tmp_path / "export")
    recorded(tmp_path / "export", STEPS + 1)
    _, recording = read(str(tmp_path / "export"), Request(sheet=sheet))
    series = recording.series
    assert {key: recording.guesses.get(key) for key in entries} == entries
    assert len(series.points) == X.size - lost
    place = series.points - series.points.min(axis=0)
    index = [int(np.argmin(np.hypot(X - x, Y - y))) for x, y in place]
    np.testing.assert_allclose(series.displacements[-1], moved(STEPS)[index], atol=1e-6)
    assert not series.has_clock  # no time of the frames is stated


@pytest.mark.parametrize(
    ("export", "message"),
    [
        (rewritten(vic3d, lines(lambda rows: [row.replace("[mm]", "[ell]") for row in rows])), r"--unit .*\[ell\]"),
        (istra4d, r"--unit .*not stated in its attributes"),
    ],
)
def test_an_unknown_unit_of_length_is_asked_for(tmp_path, export, message):
    export(tmp_path / "export")
    recorded(tmp_path / "export", STEPS + 1)
    with pytest.raises(errors.UndecidedError, match=message):
        read(str(tmp_path / "export"), Request())
    _, recording = read(str(tmp_path / "export"), Request(answers=Answers(unit="cm")))
    assert recording.guesses.get("points.unit") == "cm"


@pytest.mark.parametrize(
    ("head", "newtons"),
    [
        ("F_kN;t", 1000.0),
        ("Standardkraft [kN];Zeit [s]", 1000.0),
        ("Kraft in kN;Prüfzeit in s", 1000.0),
        ("Load (lbf);Time (sec)", 4.4482216152605),
        ("Load (gf);Time (sec)", 9.80665e-3),
        ("Axial Force;Elapsed Time", 1.0),
    ],
)
def test_records_of_other_machines(tmp_path, head, newtons):
    vic3d(tmp_path / "export")
    write(tmp_path / "export" / "machine.txt", head + "\n" + "\n".join(f"{2 * k},5;{k}" for k in range(30)) + "\n")
    _, recording = read(str(tmp_path / "export"), Request(sheet=SheetOptions(frame_rate=1.0)))
    assert recording.series.record.force[-1] == pytest.approx(58.5 * newtons)


@pytest.mark.parametrize("row", ["garbage;xx;yy", "7;8"])
def test_a_wrong_row_of_a_record_is_named(tmp_path, row):
    """It is no reason to ask for another column of time."""
    vic3d(tmp_path / "export")
    rows = [f"{k};{2 * k},5;{k}" for k in range(30)]
    write(tmp_path / "machine.txt", "\n".join(["Zeit [s];Kraft [N];Weg [mm]", *rows[:20], row, *rows[20:]]) + "\n")
    with pytest.raises(errors.FileFormatError, match=r"machine.txt, line 22: "):
        read(str(tmp_path / "export"), Request(sheet=SheetOptions(frame_rate=1.0), record=tmp_path / "machine.txt"))


def test_an_unknown_unit_of_force_is_asked_for(tmp_path):
    vic3d(tmp_path / "export")
    recorded(tmp_path / "export", STEPS + 1, "File;When;Temperature;Load [tonf]")
    with pytest.raises(errors.UndecidedError, match=r"--force-unit .*\[tonf\] is none of N"):
        read(str(tmp_path / "export"), Request())
    _, recording = read(str(tmp_path / "export"), Request(answers=Answers(force_unit="kN")))
    assert recording.series.record.force[-1] == pytest.approx(2e3 * STEPS)


@pytest.mark.parametrize("twice", [True, False])
def test_a_frame_that_was_exported_twice_is_told(tmp_path, twice):
    for k in range(STEPS + 1):
        u, v = moved(STEPS - 1 if twice and k == STEPS else k).T
        table(tmp_path / f"t-{k:03d}.csv", "X,Y,U,V", [X, Y, u, v])
    recorded(tmp_path, STEPS + 1)
    notes = read(str(tmp_path), Request())[1].experiment().provenance["notes"]
    told = f"frames {STEPS - 1} and {STEPS} hold the same displacements"
    assert any(told in note for note in notes) == twice


@pytest.mark.parametrize("counted", ["from the frame before", "from the reference"])
def test_increments_of_displacement_are_noticed(tmp_path, counted):
    increments = counted == "from the frame before"
    for k in range(STEPS + 1):
        u, v = (moved(k) - (moved(max(k - 1, 0)) if increments else 0)).T
        table(tmp_path / f"t-{k:03d}.csv", "X,Y,U,V", [X, Y, u, v])
    recorded(tmp_path, STEPS + 1)
    notes = read(str(tmp_path), Request())[1].experiment().provenance["notes"]
    assert any("counted from the frame before" in note for note in notes) == increments


def test_areas_of_one_picture_are_no_frames(tmp_path):
    vic2d(tmp_path / "export")
    for path in sorted((tmp_path / "export").iterdir()):
        write(path.with_name(path.name.replace("_0.csv", "_1.csv")), path.read_text())
    with pytest.raises(errors.UndecidedError, match="areas of one picture, choose one of them"):
        read(str(tmp_path / "export"), Request(sheet=PIXELS))


@pytest.mark.parametrize(
    ("change", "seconds"),
    [
        (lambda text: text.replace("time:s", "time:ms"), 1e-3),
        (lambda text: text.replace(",", ".").replace(";", ","), 1.0),
    ],
)
def test_times_of_zeiss_in_other_units_and_separators(tmp_path, change, seconds):
    rewritten(zeiss, lambda path: path.write_text(change(path.read_text())))(tmp_path / "export")
    recorded(tmp_path / "export", STEPS + 1)
    _, recording = read(str(tmp_path / "export"), Request())
    np.testing.assert_allclose(recording.series.time, np.arange(STEPS + 1) * seconds)


def test_a_matrix_without_its_partner_is_named(tmp_path):
    matrices(tmp_path / "export")
    (tmp_path / "export" / "pic_3.tif_V[mm].csv").unlink()
    with pytest.raises(errors.UndecidedError, match=re.escape("1 files missing, such as pic_3.tif_V[mm].csv")):
        read(str(tmp_path / "export"), Request(answers=Answers(step=2.0)))


def test_rows_of_pictures():
    """The picture of a row is a whole part of the name of a file; what fits none or two is not guessed."""
    files = ["Image_0001_0.tif.csv", "Image_0010_0.tif.csv"]
    assert rows_of_pictures(["Image_0000_0.tif", r"C:\test\Image_0001_0.TIF", "Image_0010_0.tif"], files) == [1, 2]
    assert rows_of_pictures(["Image_1.tif", "Image_10.tif"], ["Image_10.tif.csv", "Image_2.csv"]) == [1, None]
    assert rows_of_pictures(["a_1.tif", "a_1.tif"], ["a_1.csv"]) == [None]


def test_force_of_every_picture_by_its_name(tmp_path):
    """Pictures left out of the export, and the reference among them, do not shift the forces."""
    export = tmp_path / "export"
    matchid(export)
    rows = [f"Img_{k:04d}.tif;{3 * k}; {k * k}.5" for k in range(STEPS + 1)]
    write(export / "Image.csv", "\n".join(["File;TimeStamp; Force [N]", *rows]) + "\n")
    for k, kept in ((3, [0, 1, 2, 4, 5]), (0, [0, 1, 2, 4, 5])):
        next(export.glob(f"Img_{k:04d}*")).unlink()
        series = read(str(export), Request())[1].series
        np.testing.assert_allclose(series.record.force, np.square(kept) + 0.5)
        np.testing.assert_allclose(series.time, 3.0 * np.array(kept))
    write(export / "Image.csv", "\n".join(["File;TimeStamp; Force [N]", *rows]).replace("_0004", "_0044") + "\n")
    with pytest.raises(
        errors.FileFormatError, match="names the pictures of the rows, but none or several for Img_0004"
    ):
        read(str(export), Request())
