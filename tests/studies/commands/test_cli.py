"""The command line: fast help, one-line errors, configuration files, exit codes."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import types
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pytest
from cyclopts import Parameter

from calibrate.diagnosis.hold_out import Kind
from studies import cli
from studies.commandline.option_types import Count, Integers, Repeated, default_folder
from studies.commandline.outcome import Outcome
from studies.errors import OptionError


@dataclass(frozen=True)
class Said(Outcome):
    """Stands for the result of a command."""

    def lines(self) -> list[str]:
        return ["done"]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    """A command 'try' with a few options; it stores them in `module.args`, and raises `module.error` where there is one."""
    module = types.ModuleType("a_study")
    module.error = None  # type: ignore[attr-defined]

    def attempt(
        model: str,
        /,
        *,
        seeds: Count = 10,
        layers: Integers = (4, 4),
        sizes: Annotated[tuple[float, ...], Parameter(consume_multiple=True)] = (),
        without: Repeated = (),
        quick: bool = False,
    ) -> Said:
        """Try it."""
        if module.error is not None:
            raise module.error
        module.args = (model, seeds, layers, sizes, without, quick)  # type: ignore[attr-defined]
        return Said()

    module.attempt = attempt  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "a_study", module)
    monkeypatch.setitem(cli.COMMANDS, "try", cli.Command("a_study:attempt", "try it", "equigap try m"))
    return module


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom studies.cli import main\nmain(['--help'])\n"
        "sys.exit(any(name in sys.modules for name in ('jax', 'numpy', 'matplotlib', 'dolfinx', 'gmsh', 'cyclopts')))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert all(name in done.stdout for name in cli.COMMANDS)


@pytest.mark.parametrize("name", list(cli.COMMANDS))
def test_every_command_has_help_with_examples(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = cli.main([name, "--help"])
    except SystemExit as stop:
        code = stop.code
    text = capsys.readouterr().out
    assert code == 0
    assert f"equigap {name}" in text.split("examples:")[1]
    assert "--output" in text
    assert "--overwrite" in text


def test_default_folder_has_no_blanks_or_slashes():
    assert default_folder("import-my test / ä") == Path("results/import-my-test-ä")
    assert default_folder("import-../../x", quick=True).parent == Path("results")


@pytest.mark.parametrize("name", ["calibrate", "discover"])
def test_help_names_every_rule_of_holding_out(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with contextlib.suppress(SystemExit):
        cli.main([name, "--help"])
    text = capsys.readouterr().out
    rules = set(Kind) if name == "discover" else {Kind.LAST, Kind.RANDOM, Kind.EVERY, Kind.AFTER}
    assert all(rule in text for rule in rules)
    assert "random[:SHARE]" in text


def test_without_words_the_help_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([]) == 2
    assert "commands:" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["calibrat"], "did you mean calibrate"),
        (["--quick"], "the first word must be a command"),
        (["try", "m", "--sedes", "3"], "Unknown option: --sedes. Did you mean --seeds?"),
        (["try", "m", "--sedes=3"], "Unknown option: --sedes. Did you mean --seeds?"),
        (["try", "m", "--seed", "3"], "Did you mean --seeds?"),
        (["try"], "MODEL"),
        (["try", "m", "n"], "'n'"),
        (["try", "m", "n"], "joined by commas (left,right)"),
        (["try", "m", "--seeds", "many"], "'many' must be a whole number"),
        (["try", "m", "--seeds", "1.5"], "whole number"),
        (["try", "m", "--seeds", "0"], "at least 1"),
        (["try", "m", "--layers", "4;4"], "whole numbers with commas between"),
    ],
)
def test_wrong_words_are_one_line_and_exit_code_2(
    command: types.ModuleType, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    assert cli.main(words) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("equigap: error: ")
    assert captured.err.count("\n") == 1
    assert message in captured.err
    assert captured.out == ""


class TestConfig:
    def write(self, folder: Path, text: str) -> str:
        (folder / "c.toml").write_text(text)
        return str(folder / "c.toml")

    def test_sets_options_and_the_command_line_wins(self, command: types.ModuleType, tmp_path: Path) -> None:
        text = 'seeds = 3\nquick = true\nlayers = [8, 8]\nsizes = [1.5, -2]\nwithout = ["a b", "c"]\n'
        path = self.write(tmp_path, text)
        assert cli.main(["try", "m", "--config", path]) == 0
        assert command.args == ("m", 3, (8, 8), (1.5, -2.0), ("a b", "c"), True)
        cli.main(["try", f"--config={path}", "--seeds", "7", "m", "--layers", "2"])
        assert command.args == ("m", 7, (2,), (1.5, -2.0), ("a b", "c"), True)

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("sedes = 3", "unknown option 'sedes'; did you mean seeds?"),
            ("model = 'm'", "model"),
            ("help = true", "help"),
            ("seeds = 'x'", "'x' must be a whole number"),
            ("seeds = true", "seeds"),
            ("quick = 3", "quick"),
            ("[seeds]\na = 1", "seeds"),
            ("seeds == 3", "not valid TOML"),
        ],
    )
    def test_is_checked(
        self, command: types.ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, message: str
    ) -> None:
        assert cli.main(["try", "m", "--config", self.write(tmp_path, text)]) == 2
        assert message in capsys.readouterr().err

    def test_that_is_absent_is_named(self, command: types.ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
        assert cli.main(["try", "m", "--config", "absent.toml"]) == 2
        assert "absent.toml: No such file or directory; check the path" in capsys.readouterr().err


class TestFailures:
    def run(self, command: types.ModuleType, error: BaseException) -> int:
        command.error = error  # type: ignore[attr-defined]
        return cli.main(["try", "m"])

    def test_named_errors_of_every_package_are_one_line(
        self, command: types.ModuleType, capsys: pytest.CaptureFixture[str]
    ) -> None:
        from calibrate.errors import FileFormatError
        from forward.errors import MaterialError
        from meshes.errors import SpecimenError

        for kind in (FileFormatError, MaterialError, SpecimenError, OptionError):
            assert self.run(command, kind("what is wrong;\n what to do")) == 2
            assert capsys.readouterr().err == "equigap: error: what is wrong; what to do\n"

    def test_operating_system_errors_say_what_to_do(
        self, command: types.ModuleType, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert self.run(command, FileNotFoundError(2, "No such file or directory", "a.npz")) == 2
        assert capsys.readouterr().err == "equigap: error: a.npz: No such file or directory; check the path\n"
        assert self.run(command, OSError(28, "No space left on device")) == 2
        assert "free some space" in capsys.readouterr().err

    def test_an_interruption_says_that_the_run_resumes(
        self, command: types.ModuleType, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert self.run(command, KeyboardInterrupt()) == 130
        assert "goes on" in capsys.readouterr().err

    def test_a_mistake_of_ours_shows_its_trace(self, command: types.ModuleType) -> None:
        with pytest.raises(ZeroDivisionError):
            self.run(command, ZeroDivisionError())

    def test_a_trace_can_be_asked_for(self, command: types.ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("EQUIGAP_DEBUG", "1")
        with pytest.raises(OptionError):
            self.run(command, OptionError("x"))


def test_a_closed_pipe_is_no_error() -> None:
    done = subprocess.run(
        f"{sys.executable} -m studies.cli --help | true", shell=True, capture_output=True, text=True, check=False
    )
    assert "Traceback" not in done.stderr
