"""The command line: fast help, one-line errors, configuration files, exit codes."""

from __future__ import annotations

import argparse
import subprocess
import sys
import types
from pathlib import Path

import pytest

from studies import cli
from studies.errors import OptionError


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    """A command 'try' with a few options; it stores its options in `module.args`."""
    module = types.ModuleType("a_study")

    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("model")
        parser.add_argument("--seeds", type=int, default=10)
        parser.add_argument("--layers", default="4,4")
        parser.add_argument("--sizes", type=float, nargs="+")
        parser.add_argument("--quick", action="store_true")

    def main(args: argparse.Namespace) -> int:
        module.args = args  # type: ignore[attr-defined]
        return 0

    module.add_arguments, module.main = add_arguments, main  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "a_study", module)
    monkeypatch.setitem(cli.COMMANDS, "try", cli.Command("a_study", "try it", "equigap try m"))
    return module


def fail(error: BaseException) -> object:
    def main(args: argparse.Namespace) -> int:
        raise error

    return main


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom studies.cli import main\nmain(['--help'])\n"
        "sys.exit(any(name in sys.modules for name in ('jax', 'numpy', 'matplotlib', 'dolfinx', 'gmsh')))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert all(name in done.stdout for name in cli.COMMANDS)


@pytest.mark.parametrize("name", list(cli.COMMANDS))
def test_every_command_has_help_with_examples(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        cli.main([name, "--help"])
    text = capsys.readouterr().out
    assert stop.value.code == 0
    assert f"equigap {name}" in text.split("examples:")[1]
    assert "--output" in text
    assert "--overwrite" in text


def test_without_words_the_help_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([]) == 2
    assert "commands:" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["calibrat"], "did you mean calibrate"),
        (["--quick"], "the first word must be a command"),
        (["try", "m", "--sedes", "3"], "unknown option --sedes; did you mean --seeds?"),
        (["try", "m", "--sedes=3"], "unknown option --sedes; did you mean --seeds?"),
        (["try", "--seed", "3"], "unknown option --seed; did you mean --seeds?"),
        (["try"], "required: model"),
        (["try", "m", "n"], "unexpected 'n'"),
        (["try", "m", "--seeds", "many"], "invalid int value: 'many'"),
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
        path = self.write(tmp_path, "seeds = 3\nquick = true\nlayers = [8, 8]\nsizes = [1.5, -2]\n")
        assert cli.main(["try", "m", "--config", path]) == 0
        expected = {"command": "try", "model": "m", "seeds": 3, "quick": True, "layers": "8,8", "sizes": [1.5, -2.0]}
        assert vars(command.args) == expected
        cli.main(["try", "m", f"--config={path}", "--seeds", "7"])
        assert command.args.seeds == 7

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("sedes = 3", "unknown option 'sedes'; did you mean seeds?"),
            ("model = 'm'", "unknown option 'model'"),
            ("help = true", "unknown option 'help'"),
            ("seeds = 'x'", "invalid int value: 'x'"),
            ("seeds = true", "'seeds' needs a value"),
            ("quick = 3", "'quick' is a switch"),
            ("[seeds]\na = 1", "'seeds' is a table"),
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
        assert "absent.toml: cannot be read (No such file or directory)" in capsys.readouterr().err


class TestFailures:
    def run(self, command: types.ModuleType, error: BaseException) -> int:
        command.main = fail(error)  # type: ignore[attr-defined]
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

    def test_a_missing_module_is_named(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.setitem(cli.COMMANDS, "try", cli.Command("studies.absent", "", ""))
        assert cli.main(["try"]) == 2
        assert "not part of this version" in capsys.readouterr().err


def test_a_closed_pipe_is_no_error() -> None:
    done = subprocess.run(
        f"{sys.executable} -m studies.cli --help | true", shell=True, capture_output=True, text=True, check=False
    )
    assert "Traceback" not in done.stderr
