"""Exports of DIC programs: recognised from their content, read without editing; what is not stated is asked for by name."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from sheets import write
from vendor_exports import (
    SCALE,
    STEPS,
    X,
    Y,
    dice,
    dice_stereo,
    istra4d,
    matchid,
    matrices,
    moved,
    mudic,
    ncorr,
    ncorr_73,
    opencorr,
    table,
    vic2d,
    vic3d,
    zeiss,
)

from calibrate import errors
from calibrate.data.experiment import Experiment
from studies.commands.import_data import Request, SeveralImported, import_data, import_experiment, read
from studies.importers import column_import, importer_of
from studies.importers.column_map import read_map
from studies.importers.exports.guesses import Undecided
from studies.importers.recording.importer import Answers, SheetOptions
from studies.importers.vendors import vendors

EXPORTS = Path(os.environ.get("EQUIGAP_DATA", "nowhere")) / "dic_exports"
needs_exports = pytest.mark.skipif(not EXPORTS.is_dir(), reason="EQUIGAP_DATA names no folder with dic_exports")


def asked(source: Path, **options) -> Undecided:
    with pytest.raises(Undecided) as caught:
        read(str(source), Request(**options))
    return caught.value


@needs_exports
@pytest.mark.parametrize(
    ("folder", "keys", "files", "entries"),
    [
        (
            "dice/challenge_12",
            {"points.scale_mm_per_px", "force.file"},
            [f"DICe_solution_0{k}.txt" for k in (1, 2, 3, 4)],
            {
                "points.u": "DISPLACEMENT_X",
                "points.y_axis": "down",
                "points.valid_column": "MATCH",
                "points.reference": "separate",  # the header's reference picture oht_cfrp_00 has no file
                "edges.loaded": ["bottom", "top"],
                "recording.subset": "27 px",
                "recording.strain_window": "360 px",
            },
        ),
        (
            "dice/stereo_auto",  # three static pictures: nothing tells the pull
            {"points.scale_mm_per_px", "force.file", "edges.loaded"},
            [f"DICe_solution_auto_{k}.txt" for k in range(4)],
            {"points.unit": "px", "points.reference": None, "points.z": None},
        ),
        (
            "gom_zeiss",
            {"force.file"},
            [f"Flächenkomponente 1_{t} s.csv" for t in ("0.000", "21.555", "24.222", "26.888", "29.555", "32.222")],
            {
                "points.coordinates": "current",
                "points.w": "displacement_z",
                "points.unit": "mm",
                "edges.loaded": ["left", "right"],
                "frames.times_s": [0.0, 21.5551, 24.2217, 26.8884, 29.5551, 32.2217],  # of the stage rows
            },
        ),
        (
            "matchid",
            {"force.file", "points.files", "points.v", "points.step"},
            ["patD107_0.tif_U[mm].csv", "patD108_0.tif_U[mm].csv"],
            {"points.layout": "matrix", "points.decimal": ",", "points.header_line": 0},
        ),
    ],
)
def test_real_exports_up_to_what_is_not_stated(folder, keys, files, entries):
    found = asked(EXPORTS / folder).guesses
    assert {question.key for question in found.questions} == keys
    assert found.get("points.files") == files
    assert {key: found.get(key) for key in entries} == entries
    assert all(why for _, why in found.entries.values())


@needs_exports
def test_a_real_table_of_matchid():
    error = asked(EXPORTS / "matchid", answers=Answers(files="Img_*.csv"))
    assert {question.key for question in error.guesses.questions} == {"force.file"}
    assert error.guesses.get("points.x") == "coor.Image X [mm]"
    assert error.guesses.get("edges.loaded") == ["bottom", "top"]  # its exported Eyy is 0.4 to 2 %
    with pytest.raises(errors.ConfigError, match="--scale: nothing in this export is in pixels"):
        read(str(EXPORTS / "matchid"), Request(answers=Answers(files="Img_*.csv"), sheet=SheetOptions(scale=0.1)))


@pytest.mark.slow
@needs_exports
def test_a_real_export_with_a_record_goes_through_and_its_map_again(tmp_path):
    record = write(tmp_path / "cell.csv", "Zeit [s];Kraft [kN]\n20,0;0,0\n25,0;-0,6\n33,0;-2,0\n", "latin-1")
    _, recording = read(str(EXPORTS / "gom_zeiss"), Request(record=record))
    first = recording.experiment()
    written = write(tmp_path / "out" / "column_map.toml", recording.guesses.toml(tmp_path / "out"))
    again = import_experiment(written)
    assert first.fingerprint == again.fingerprint
    assert first.noise == again.noise
    np.testing.assert_array_equal(first.time, again.time)
    assert first.loaded[1].force[-1, 0] == pytest.approx(1865, rel=0.01)  # 2 kN in tension at 33 s, frame at 32.2 s
    plane = first.provenance["specimen_plane"]
    assert plane["tilt_degrees"] < 0.5
    spans = [np.ptp(first.points[b.nodes, 1]) / np.ptp(first.points[:, 1]) for b in first.loaded]
    assert min(spans) > 0.9  # rows are not parallel to the axes, and all of the section is loaded


@pytest.mark.parametrize(
    ("header", "crosshead"),
    [
        ("Zeit [s];Kraft [kN];Traversenweg [mm]", "Traversenweg [mm]"),
        ("Time [s];Force [kN];Crosshead", "Crosshead"),
        ("Time [s];Load [kN];Extension;Stroke", None),
    ],
)
def test_the_crosshead_of_a_record_is_recognised(tmp_path, header, crosshead):
    """By its name; of two such columns none is taken."""
    zeiss(tmp_path / "export")
    columns = header.count(";") - 1
    rows = "".join(f"{t};{f}{';1,5' * columns}\n" for t, f in (("0,0", "0,0"), ("2,0", "0,6"), ("5,0", "2,0")))
    record = write(tmp_path / "cell.csv", f"{header}\n{rows}", "latin-1")
    _, recording = read(str(tmp_path / "export"), Request(record=record))
    assert recording.guesses.get("force.crosshead") == crosshead
    assert (recording.series.record.crosshead is not None) == (crosshead is not None)


# --- one test in the form of every program: the same Experiment comes out ---

METRES = Answers(unit="m")
PIXELS = SheetOptions(scale=SCALE)


@pytest.mark.parametrize(
    ("export", "program", "sheet", "answers"),
    [
        (dice, "DICe", PIXELS, Answers()),
        (dice_stereo, "DICe", SheetOptions(), Answers()),
        (zeiss, "ZEISS/GOM Correlate", SheetOptions(), Answers()),
        (matchid, "MatchID (tables)", SheetOptions(), Answers()),
        (matrices, "MatchID (matrices)", SheetOptions(), Answers(step=2.0)),
        (vic2d, "VIC-2D, VIC-3D", PIXELS, Answers()),
        (vic3d, "VIC-2D, VIC-3D", SheetOptions(), Answers()),
        (opencorr, "OpenCorr", PIXELS, Answers()),
        (mudic, "muDIC", PIXELS, Answers()),
        (ncorr, "ncorr", SheetOptions(), Answers()),
        (ncorr_73, "ncorr", SheetOptions(), Answers()),
        (istra4d, "Istra4D", SheetOptions(), METRES),
    ],
)
def test_one_field_in_the_form_of_every_program(tmp_path, export, program, sheet, answers):
    folder = tmp_path / "export"
    export(folder)
    frames = STEPS + (export not in (dice, matrices, ncorr, ncorr_73))  # files of those without one of the reference
    rows = [f"a{k}.tif;12:0{k};  {k}.0;  {2 * k}.0" for k in range(frames)]
    write(folder / "Image.csv", "\n".join(["File;TimeStamp; Force [V]; Force [N]", *rows]) + "\n")
    _, recording = read(str(folder), Request(sheet=sheet, answers=answers))
    assert recording.guesses.facts[0].startswith(f"program: {program};")
    series = recording.series
    assert len(series.displacements) == STEPS + 1
    centred = series.points - series.points.mean(axis=0)
    order = np.lexsort([centred[:, 0].round(3), centred[:, 1].round(3)])
    np.testing.assert_allclose(centred[order], np.column_stack([X - X.mean(), Y - Y.mean()]), atol=1e-6)
    for k, u in enumerate(series.displacements[:, order]):
        np.testing.assert_allclose(u, moved(k), atol=1e-6)
    stereo = export in (dice_stereo, zeiss, vic3d, istra4d)
    assert (series.heights is not None) == stereo
    if stereo:  # moves towards the camera by so much in each frame; the tilt of a specimen is none
        rate = {dice_stereo: -1.0, zeiss: 0.0, vic3d: 0.1, istra4d: 0.1}[export]
        np.testing.assert_allclose(series.heights, rate * np.arange(STEPS + 1)[:, None] + 0 * X, atol=1e-6)
    assert recording.guesses.get("edges.loaded") == ["left", "right"]
    assert recording.guesses.get("force.per_frame") is True
    written = write(tmp_path / "out" / "column_map.toml", recording.guesses.toml(tmp_path / "out"))
    again = column_import.mapped_series(read_map(written), written.parent)
    np.testing.assert_array_equal(again.displacements, series.displacements)
    np.testing.assert_array_equal(again.record.force, series.record.force)


def test_istra4d_is_asked_for_unit_and_analog_channel(tmp_path):
    istra4d(tmp_path / "export")
    error = asked(tmp_path / "export")
    assert {question.key for question in error.guesses.questions} == {"points.unit", "force.force"}
    assert "analog_channels[1] (0 to 2.5)" in str(error)
    answers = Answers(unit="m", force_column="add_data/analog_channels[0]", force_unit="kN")
    _, recording = read(str(tmp_path / "export"), Request(answers=answers))
    np.testing.assert_allclose(recording.series.record.force, 2e3 * np.arange(STEPS + 1))
    written = write(tmp_path / "out" / "column_map.toml", recording.guesses.toml(tmp_path / "out"))
    again = column_import.mapped_series(read_map(written), written.parent)
    np.testing.assert_array_equal(again.record.force, recording.series.record.force)


def test_every_vendor_says_where_it_was_tested():
    found = vendors()
    assert len(found) >= 7
    assert {vendor.name for vendor in found if vendor.tested_on} >= {"DICe", "ZEISS/GOM Correlate"}
    assert all(vendor.documentation for vendor in found)


def test_questions_leave_a_column_map_to_be_completed(tmp_path):
    vic2d(tmp_path / "export")
    with pytest.raises(errors.UndecidedError, match=r"--scale .*--record .*column_map.toml"):
        import_data(str(tmp_path / "export"), output=tmp_path / "out")
    text = (tmp_path / "out-column_map.toml").read_text()
    assert "# missing: points.scale_mm_per_px (--scale)" in text
    with pytest.raises(errors.ConfigError, match="--loaded up: unknown"):
        Answers(loaded=("up",))
    record = write(tmp_path / "r.csv", "Time,Force\n" + "".join(f"{k},{k}\n" for k in range(9)))
    with pytest.raises(errors.UndecidedError, match=r"--loaded.*left and right by the pull, but --free names left"):
        read(
            str(tmp_path / "export"),
            Request(record=record, sheet=SheetOptions(scale=1.0, frame_rate=1.0), answers=Answers(free=("left",))),
        )
    across = Request(
        record=record, sheet=SheetOptions(scale=1.0, frame_rate=1.0), answers=Answers(loaded=("bottom", "top"))
    )
    with pytest.raises(errors.ConfigError, match=r"shortens along this one.*is it --loaded left,right"):
        read(str(tmp_path / "export"), across)
    with pytest.raises(errors.ConfigError, match="--drop-rows is for printed sheets"):
        read(str(tmp_path / "export"), Request(sheet=SheetOptions(drop_rows=1)))


def test_a_cross_with_two_load_cells(tmp_path):
    """Four arms, two cells, one column map; each axis has the force of its own cell."""
    x, y = (v.ravel() for v in np.meshgrid(np.arange(-10.0, 11), np.arange(-10.0, 11)))
    inside = (np.abs(x) <= 4) | (np.abs(y) <= 4)
    x, y = x[inside], y[inside]
    for k in range(6):
        table(tmp_path / f"f_{k}.csv", "x,y,u,v", [x, y, 0.01 * k * x, 0.02 * k * y])
    write(tmp_path / "cells.csv", "t,Fx,Fy\n" + "".join(f"{k},{k},{-0.003 * k}\n" for k in range(6)))
    cell = '[[force]]\nfile = "cells.csv"\ntime = "t"\n'
    text = (
        'name = "cross"\n[points]\nfiles = "f_*.csv"\nx = "x"\ny = "y"\nu = "u"\nv = "v"\n[frames]\nrate_hz = 1.0\n'
        f'{cell}force = "Fx"\nsides = ["left", "right"]\n{cell}force = "Fy"\nunit = "kN"\nsign = -1.0\nsides = ["bottom", "top"]\n'
        '[edges]\nloaded = ["left", "right", "bottom", "top"]\nfree = ["holes"]\n'
    )
    path = write(tmp_path / "map.toml", text)
    experiment: Experiment = importer_of(str(path)).read(str(path), SheetOptions(), None, None).experiment()
    forces = {b.name: b.force[-1] for b in experiment.loaded}
    assert forces["right"][0] == pytest.approx(5.0)
    assert forces["left"][0] == pytest.approx(-5.0)
    assert forces["top"][1] == pytest.approx(15.0)
    assert np.isnan(forces["top"][0])
    write(path, text.replace('sides = ["bottom", "top"]', 'sides = ["bottom"]'))
    with pytest.raises(errors.ConfigError, match="every side of edges.loaded needs one load cell"):
        read_map(path)


def test_documentation_says_which_programs_were_tested():
    text = (Path(__file__).parents[3] / "docs" / "import.md").read_text()
    for vendor in vendors():
        assert f"| {vendor.name} | " in text
        row = next(line for line in text.splitlines() if line.startswith(f"| {vendor.name} | "))
        assert row.split("|")[3].strip().startswith("yes" if vendor.tested_on else "no")


def test_several_tests_in_one_column_map(tmp_path):
    for name, factor in (("first", 1.0), ("second", 2.0)):
        for k in range(STEPS + 1):
            table(tmp_path / name / f"f_{k}.csv", "x,y,u,v", [X, Y, *moved(k).T])
        write(tmp_path / name / "force.csv", "F\n" + "".join(f"{factor * k}\n" for k in range(STEPS + 1)))
    text = (
        'thickness_mm = 1.0\n[points]\nfiles = "f_*.csv"\nx = "x"\ny = "y"\nu = "u"\nv = "v"\n'
        '[force]\nforce = "F"\nper_frame = true\n[edges]\nloaded = ["left", "right"]\n'
    )
    for name in ("first", "second"):
        text += f'[[test]]\nname = "{name}"\npoints.folder = "{name}"\nforce.file = "{name}/force.csv"\n'
    path = write(tmp_path / "tests.toml", text + "thickness_mm = 2.0\n")
    both = import_data(str(path), output=tmp_path / "out")
    assert isinstance(both, SeveralImported)
    assert [one.path for one in both.tests] == [tmp_path / "out" / n / "experiment.npz" for n in ("first", "second")]
    first, second = (one.experiment for one in both.tests)
    np.testing.assert_allclose(second.loaded[1].force[:, 0], 2 * first.loaded[1].force[:, 0])
    assert (first.thickness, second.thickness) == (1.0, 2.0)
    assert import_experiment(f"{path}#second").fingerprint == second.fingerprint
    with pytest.raises(errors.ConfigError, match="holds several tests; name one: .*#first"):
        read_map(path)
