"""`equigap figures`: what is finished is not made again, what failed is named, every file is listed with its record."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image

from studies import cli
from studies.commandline import application
from studies.commands.reproduction import figures
from studies.errors import OptionError


def steps() -> list[figures.Step]:
    return [
        figures.Step("simulate", figures.USUAL),
        figures.Step("calibrate", figures.USUAL, ("FOLDER/simulate/experiment.npz",), parallel=True),
    ]


class Runs:
    """Stands for the commands: makes their folder with a picture and a manifest; `codes` are exit codes in order."""

    def __init__(self, *codes: int) -> None:
        self.codes, self.lines = list(codes), []

    def __call__(self, line: list[str], log: Path) -> tuple[int, float]:
        from studies.output import Manifest

        self.lines.append(line)
        folder = Path(line[line.index("--output") + 1])
        folder.mkdir(parents=True, exist_ok=True)
        Image.new("RGB", (900, 300), "white").save(folder / "forces.png")
        Manifest().beside(folder / "forces.png")
        return (self.codes.pop(0) if self.codes else 0), 400.0


def test_every_step_is_a_command_whose_words_are_understood(tmp_path: Path) -> None:
    for step in figures.STEPS:
        for scale in step.of_scale:
            words = step.line(scale, tmp_path, 2)
            options = application.parse(cli.targets(words[0]), words)
            assert options["output"] == tmp_path / step.name


def test_what_is_finished_is_not_made_again_whatever_the_jobs(tmp_path: Path) -> None:
    first, second = Runs(), Runs()
    assert figures.run_all(steps(), "quick", tmp_path, 2, first) == []
    assert figures.run_all(steps(), "quick", tmp_path, 4, second) == []
    assert [line[0] for line in first.lines] == ["simulate", "calibrate"]
    assert first.lines[1][1] == str(tmp_path / "simulate" / "experiment.npz")
    assert second.lines == []


def test_what_failed_is_named_and_made_again(tmp_path: Path) -> None:
    assert figures.run_all(steps(), "quick", tmp_path, 2, Runs(0, 2)) == ["calibrate"]
    again = Runs()
    assert figures.run_all(steps(), "quick", tmp_path, 2, again) == []
    assert [line[0] for line in again.lines] == ["calibrate"]


def test_what_studies_cost_is_listed(tmp_path: Path) -> None:
    figures.run_all(steps(), "quick", tmp_path, 2, Runs(0, 2))
    (line,) = figures.costs(tmp_path, steps())
    assert line.split() == ["simulate", "0", "s", "400", "MB"]


def test_an_interruption_stops_everything(tmp_path: Path) -> None:
    runs = Runs(130)
    with pytest.raises(KeyboardInterrupt):
        figures.run_all(steps(), "quick", tmp_path, 2, runs)
    assert len(runs.lines) == 1


def test_another_scale_is_made_anew(tmp_path: Path) -> None:
    figures.run_all(steps(), "quick", tmp_path, 2, Runs())
    runs = Runs()
    figures.run_all(steps(), "default", tmp_path, 2, runs)
    assert len(runs.lines) == 2


def test_the_page_shows_every_picture_and_lists_its_record(tmp_path: Path) -> None:
    figures.run_all(steps(), "quick", tmp_path, 2, Runs())
    text = figures.write_page(tmp_path, "quick", {"measured": "no <data>"}, ["blind"]).read_text()
    assert text.count('<img src="data:image/png;base64,') == 2
    assert "no &lt;data&gt;" in text and "finished/blind.log" in text
    listed = json.loads((tmp_path / "figures.json").read_text())
    assert {f["file"]: f["manifest"] for f in listed["files"]} == {
        f"{name}/forces.png": f"{name}/forces.json" for name in ("simulate", "calibrate")
    }
    assert all(len(f["sha256"]) == 64 for f in listed["files"])


def test_every_study_is_listed_with_the_revision_that_finished_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = steps()
    for step, made_by in ((first, "old"), (second, "new")):
        monkeypatch.setattr(figures, "revision", lambda name=made_by: name)
        assert figures.run_all([step], "quick", tmp_path, 2, Runs()) == []
    figures.write_page(tmp_path, "quick", {}, [])
    listed = json.loads((tmp_path / "figures.json").read_text())
    assert {name: one["revision"] for name, one in listed["finished"].items()} == {
        "simulate": "old",
        "calibrate": "new",
    }
    assert all(one["versions"]["python"] for one in listed["finished"].values()) and "revision" not in listed


def test_a_real_command_runs_in_a_process_of_its_own(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "log"
    code, peak = figures._run(["specimens", "--only", "nothing", "--output", str(tmp_path / "out")], log)
    assert code == 2
    assert 10 < peak < 4000  # MB
    assert "'nothing'" in capfd.readouterr().err


def test_an_unknown_study_is_named() -> None:
    with pytest.raises(OptionError, match="thickness"):
        figures.chosen(("specimens", "thicknes"))
