"""The command `equigap import`."""

from __future__ import annotations

from pathlib import Path

import pytest
from sheets import SCALE, mapped, packed, write_frames

from calibrate import errors
from calibrate.data.experiment import Experiment, Noise
from studies import cli
from studies.errors import OptionError


@pytest.fixture
def folder(tmp_path) -> Path:
    """Frames and machine record of a small sheet."""
    return write_frames(tmp_path)


@pytest.fixture
def run(monkeypatch):
    """Run the command line; its errors are raised."""
    monkeypatch.setenv("EQUIGAP_DEBUG", "1")
    return lambda *words: cli.main(["import", *map(str, words)])


def test_command_writes_experiment_picture_and_manifest(run, tmp_path, capsys):
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
    said = capsys.readouterr().out
    assert "3 increments" in said
    assert "thickness unknown" in said
    page = (out / "report.html").read_text()
    assert "N/mm, as the thickness is unknown" in page and page.count("<img") == 1
    with pytest.raises(Exception, match="other settings"):
        run(source, "-o", out, "--scale", SCALE, "--frames", "5")
    assert run(source, "-o", out, "--scale", SCALE, "--frames", "5", "--overwrite") == 0


def test_command_reads_a_folder_and_a_column_map(run, tmp_path, folder):
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


@pytest.mark.parametrize(
    "words", [("--displacement-std", 0.01), ("--frames", 5), ("--thickness", 2), ("--record", "r.csv"), ("--name", "x")]
)
def test_what_a_column_map_says_itself_is_refused_as_an_option(run, tmp_path, words):
    with pytest.raises(errors.ConfigError, match=f"{words[0]} is not for a column map"):
        run(mapped(tmp_path / "m"), "-o", tmp_path / "b", *words)
    assert not (tmp_path / "b").exists()


def test_command_refuses_what_it_cannot_read(run, tmp_path):
    (tmp_path / "film.avi").write_text("no table")
    with pytest.raises(errors.FileFormatError, match="no importer reads this; give .*a column map"):
        run(tmp_path / "film.avi", "-o", tmp_path / "a")
    with pytest.raises(errors.DataNotFoundError, match="no such file"):
        run(tmp_path / "absent.npz", "-o", tmp_path / "a")
    run(packed(tmp_path / "e.npz"), "-o", tmp_path / "e", "--scale", SCALE, "--frames", "3,6,9")
    with pytest.raises(errors.FileFormatError, match="an Experiment already"):
        run(tmp_path / "e" / "experiment.npz", "-o", tmp_path / "a")
    with pytest.raises(errors.DataNotFoundError, match="a published sheet"):
        run(tmp_path / "nothing", "-o", tmp_path / "a")
    with pytest.raises(errors.MissingForceError, match="no force record"):
        run(packed(tmp_path / "s.npz", force_N=None), "-o", tmp_path / "a")
    with pytest.raises(OptionError, match="--frames"):
        run(packed(tmp_path / "s.npz"), "-o", tmp_path / "a", "--frames", "many")
    assert not (tmp_path / "a").exists()
