"""The command `equigap import`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from sheets import SCALE, mapped, packed, write_frames

from calibrate import errors
from calibrate.data.experiment import Experiment
from studies import cli
from studies.errors import OptionError, OutputFolderError
from studies.importers import importer_of
from studies.importers.printed_sheets import PrintedSheets


@pytest.fixture
def folder(tmp_path) -> Path:
    """Frames and machine record of a small sheet."""
    return write_frames(tmp_path)


@pytest.fixture
def run(monkeypatch):
    """Run the command line; its errors are raised."""
    monkeypatch.setenv("EQUIGAP_DEBUG", "1")
    return lambda *words: cli.main(["import", *map(str, words)])


def test_command_writes_experiment_picture_and_manifest(run, tmp_path):
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
        "experiment.vtu",
        "run.json",
        "report.html",
    }
    assert (out / "report.html").read_text().count("<img") == 1
    with pytest.raises(OutputFolderError, match="--overwrite"):
        run(source, "-o", out, "--scale", SCALE, "--frames", "5")
    assert run(source, "-o", out, "--scale", SCALE, "--frames", "5", "--overwrite") == 0


def test_command_reads_a_folder_and_a_column_map(run, tmp_path, folder):
    (folder / "force_disp.txt").rename(tmp_path / "record.csv")
    with pytest.raises(errors.MissingForceError, match="--record"):
        run(folder, "-o", tmp_path / "a")
    words = f"--record {tmp_path / 'record.csv'} --scale {SCALE} --frame-rate 2 --displacement-std 0.001"
    assert run(folder, "-o", tmp_path / "a", *words.split()) == 0
    stated = Experiment.load(tmp_path / "a" / "experiment.npz").noise
    assert stated.displacement_std == 0.001
    assert stated.force_std > 0  # estimated
    assert run(mapped(tmp_path / "m"), "-o", tmp_path / "b") == 0
    assert Experiment.load(tmp_path / "b" / "experiment.npz").name == "mapped"


@pytest.mark.parametrize(
    "words", [("--displacement-std", 0.01), ("--frames", 5), ("--thickness", 2), ("--record", "r.csv"), ("--name", "x")]
)
def test_what_a_column_map_says_itself_is_refused_as_an_option(run, tmp_path, words):
    with pytest.raises(errors.ConfigError, match=words[0]):
        run(mapped(tmp_path / "m"), "-o", tmp_path / "b", *words)
    assert not (tmp_path / "b").exists()


def test_command_refuses_what_it_cannot_read(run, tmp_path):
    (tmp_path / "film.avi").write_text("no table")
    run(packed(tmp_path / "e.npz"), "-o", tmp_path / "e", "--scale", SCALE, "--frames", "3,6,9")
    for source, more, kind, key in (
        (tmp_path / "film.avi", (), errors.FileFormatError, "film.avi"),
        (tmp_path / "absent.npz", (), errors.DataNotFoundError, "absent.npz"),
        (tmp_path / "e" / "experiment.npz", (), errors.FileFormatError, "experiment.npz"),
        (tmp_path / "nothing", (), errors.DataNotFoundError, "nothing"),
        (packed(tmp_path / "s.npz", force_N=None), (), errors.MissingForceError, "s.npz"),
        (packed(tmp_path / "t.npz"), ("--frames", "many"), OptionError, "--frames"),
    ):
        with pytest.raises(kind, match=key):
            run(source, "-o", tmp_path / "a", *more)
    assert not (tmp_path / "a").exists()


def test_a_folder_is_told_by_its_content(run, tmp_path, folder):
    """Not by whichever importer is asked first; where none fits, what was looked for is said."""
    other = tmp_path / "other"
    other.mkdir()
    (other / "frame_000.csv").write_text("X,Y,U,V\n0,0,0,0\n")
    with pytest.raises(errors.FileFormatError, match=r"other: no importer .* column map") as raised:
        run(other, "-o", tmp_path / "a")
    assert all(name in str(raised.value) for name in ("output_nodes.csv", "force_disp.csv", "x_px", ".toml"))
    (tmp_path / "empty").mkdir()
    with pytest.raises(errors.FileFormatError, match="no importer"):
        run(tmp_path / "empty", "-o", tmp_path / "a")
    assert isinstance(importer_of(str(folder)), PrintedSheets)


def test_two_importers_that_read_the_same(monkeypatch, folder):
    monkeypatch.setattr("studies.importers.importers", lambda: [PrintedSheets(), PrintedSheets()])
    with pytest.raises(errors.FileFormatError, match="PrintedSheets .* both read this"):
        importer_of(str(folder))


def test_only_options_that_an_importer_uses_are_taken_and_recorded(run, tmp_path):
    """The map says frames, scale and noise itself: the report must not show others that were not used."""
    assert run(mapped(tmp_path / "m"), "-o", tmp_path / "b") == 0
    settings = json.loads((tmp_path / "b" / "experiment.json").read_text())["settings"]
    assert settings == {"source": str(tmp_path / "m" / "map.toml")}
    report = (tmp_path / "b" / "report.html").read_text()
    assert "map / points / scale_mm_per_px" in report
    assert "edge_columns" not in report
    assert "{&#39;" not in report  # no table as Python writes it
