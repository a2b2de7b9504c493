"""`equigap verify`: numbers that are as they were, numbers that differ, files that differ."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from studies import cli
from studies.commands.reproduction import verify as verification
from studies.commands.reproduction.figures import STEPS
from studies.commands.reproduction.verify import Key


def run(folder: Path, force: float = 10.0, scale: str = "quick") -> Path:
    """Stands for a run of `figures` with one study."""
    (folder / "simulate").mkdir(parents=True)
    (folder / "figures.json").write_text(json.dumps({"format": "equigap-figures", "scale": scale, "left_out": {}}))
    (folder / "simulate" / "forces.json").write_text(json.dumps({"results": {"force": [1.0, force]}}))
    (folder / "simulate" / "forces.csv").write_text(f"force\n{force}\n")
    return folder


KEY = Key("largest force", "simulate/forces.json", ("results", "force", 1), 10.0, 0.1)


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verification, "reference", lambda scale: [KEY])


@pytest.mark.parametrize(("force", "agrees"), [(10.0, True), (10.0999, True), (10.2, False), (float("nan"), False)])
def test_a_number_agrees_within_its_tolerance(tmp_path: Path, force: float, agrees: bool) -> None:
    (finding,) = verification.compared(run(tmp_path / "a", force), [KEY])
    assert finding.agrees is agrees


def test_what_differs_is_named(tmp_path: Path, known: None, equigap) -> None:
    assert equigap("verify", run(tmp_path / "a")).code == 0
    said = equigap("verify", run(tmp_path / "b", 11.0))
    assert said.code == 2 and "largest force" in said.err
    (row,) = json.loads((tmp_path / "b" / "verify.json").read_text())["numbers"]
    assert (row["found"], row["reference"], row["agrees"]) == (11.0, 10.0, False)


def test_an_absent_number_does_not_agree_unless_its_study_was_left_out(tmp_path: Path) -> None:
    folder = run(tmp_path / "a")
    (folder / "simulate" / "forces.json").unlink()
    assert [f.agrees for f in verification.compared(folder, [KEY])] == [False]
    assert verification.compared(folder, [KEY], {"simulate": "no data"}) == []


def test_where_everything_was_left_out_nothing_is_said_to_agree(tmp_path: Path, known: None, equigap) -> None:
    folder = run(tmp_path / "a")
    content = {"format": "equigap-figures", "scale": "quick", "left_out": {"simulate": "no data"}}
    (folder / "figures.json").write_text(json.dumps(content))
    said = equigap("verify", folder)
    assert said.code == 2 and "nothing was compared" in said.err and "simulate" in said.err
    assert not (folder / "verify.json").exists()


@pytest.mark.parametrize(
    "words",
    [
        ["--collect", "b", "--same-as", "b"],
        ["--collect", "b", "-o", "table.json"],
        ["--same-as", "b", "-o", "table.json"],
        ["--same-as", "b", "--overwrite"],
    ],
)
def test_options_without_effect_are_refused(tmp_path: Path, words: list[str], equigap, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    run(Path("a"))
    run(Path("b"))
    said = equigap("verify", "a", *words)
    assert said.code == 2 and words[0] in said.err and not Path("table.json").exists()


def test_tolerances_come_from_the_spread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders = [run(tmp_path / name, force) for name, force in (("a", 10.0), ("b", 10.1), ("c", 10.3))]
    monkeypatch.setattr(verification, "stored", lambda: [{"name": KEY.name, "file": KEY.file, "path": KEY.path}])
    found = verification.reference_from(folders)["quick"][KEY.name]
    assert found == {"value": 10.1, "tolerance": pytest.approx(3 * 0.3)}


def test_data_files_are_compared_byte_by_byte(tmp_path: Path, equigap) -> None:
    a, b, c = run(tmp_path / "a"), run(tmp_path / "b"), run(tmp_path / "c", 10.1)
    assert equigap("verify", a, "--same-as", b).code == 0
    said = equigap("verify", a, "--same-as", c)
    assert said.code == 2 and "simulate/forces.csv" in said.err


@pytest.mark.parametrize("content", ["", '{"format": "other"}', "[1, 2]"])
def test_what_is_no_run_is_refused(tmp_path: Path, content: str, refused) -> None:
    if content:
        (tmp_path / "figures.json").write_text(content)
    refused("verify", tmp_path, key="figures")


def test_every_reference_names_a_step_of_figures_and_has_a_reason() -> None:
    names = {step.name for step in STEPS}
    for scale in ("quick", "default"):
        for key in verification.reference(scale):
            assert key.study in names
            assert key.tolerance > 0
            assert key.reason


def test_a_file_of_somebody_else_is_not_replaced(tmp_path: Path, known: None, refused) -> None:
    folder, other = str(run(tmp_path / "a")), tmp_path / "mine.json"
    other.write_text('{"mine": 1}')
    refused("verify", folder, key="mine.json", output=other)
    assert cli.main(["verify", folder, "-o", str(other), "--overwrite"]) == 0
    assert cli.main(["verify", folder, "-o", str(other)]) == 0


@pytest.mark.slow
def test_two_runs_give_identical_data_files(tmp_path: Path) -> None:
    """Solved, seen, calibrated and predicted twice, in processes of their own."""
    for name in ("a", "b"):
        words = ["--scale", "quick", "--only", "simulate,calibrate,predict", "--jobs", "1", "-o", str(tmp_path / name)]
        assert cli.main(["figures", *words]) == 0
    assert cli.main(["verify", str(tmp_path / "a"), "--same-as", str(tmp_path / "b")]) == 0
