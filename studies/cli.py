"""`equigap`: the command line in, one call of a study's `main(args)` out.

A subcommand's module is imported when it is chosen, so `equigap --help` answers at once. What a user can mend
ends in one line 'equigap: error: what is wrong; what to do' and exit code 2; an interruption in exit code 130.
"""

from __future__ import annotations

import argparse
import errno
import importlib
import os
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, NoReturn

from studies.errors import OptionError, StudyError
from studies.options import nearest


@dataclass(frozen=True)
class Command:
    """A subcommand: module with `add_arguments(parser)` and `main(args) -> int`, one line, examples."""

    module: str
    summary: str
    examples: str


COMMANDS = {
    "specimens": Command(
        "studies.specimens",
        "mesh and draw every specimen",
        "equigap specimens\n  equigap specimens --only cross --set half_width=35",
    ),
    "simulate": Command(
        "studies.simulation",
        "solve a test by finite elements and record it with a noisy camera",
        "equigap simulate --quick\n  equigap simulate --material neo_hooke --displacement 40 --seed 3",
    ),
    "import": Command(
        "studies.importing",
        "read measured full-field data into an Experiment",
        "equigap import Soft_Homo\n  equigap import columns.toml --output results/my-sheet",
    ),
    "calibrate": Command(
        "studies.calibration",
        "identify a network from an Experiment",
        "equigap calibrate results/simulate/experiment.npz\n  equigap calibrate sheet.npz --inputs I1I2 --layers 4,4",
    ),
    "predict": Command(
        "studies.prediction",
        "uniaxial, equi-biaxial and pure-shear curves of a model",
        "equigap predict results/calibrate/model.json\n  equigap predict model.json --stretch 2.5 --against arruda_boyce",
    ),
    "resolution": Command(
        "studies.resolution",
        "study: how camera resolution and noise limit what is identified",
        "equigap resolution --quick\n  equigap resolution --jobs 8 --output results/resolution",
    ),
    "supervised": Command(
        "studies.supervised",
        "fit networks directly to stress-stretch data",
        "equigap supervised --quick",
    ),
}
INTRODUCTION = """\
Calibrate neural-network hyperelastic models from full-field measurements.
Units: N, mm, MPa (N/mm where the thickness is unknown), s."""
CLOSING = """\
examples:
  equigap simulate --quick                                  a synthetic test of the cross
  equigap calibrate results/simulate-quick/experiment.npz   the model behind it
  equigap resolution --quick                                a whole study in about a minute

An output folder is never overwritten silently: the same command resumes there, another is refused unless
--overwrite is given. `equigap COMMAND --help` lists the options of a command."""


class Parser(argparse.ArgumentParser):
    """Errors in one line, with the nearest option there is. reads_config: whether --config is handled here."""

    reads_config = False

    def error(self, message: str) -> NoReturn:
        raise OptionError(f"{message}; see `{self.prog} --help`")

    def options(self) -> list[str]:
        """Long options, such as '--output'."""
        return [name for action in self._actions for name in action.option_strings if name.startswith("--")]

    def action(self, option: str) -> argparse.Action | None:
        """The action behind an option such as '--output'."""
        return next((a for a in self._actions if option in a.option_strings), None)


def overview() -> Parser:
    """The parser of `equigap` itself: lists the commands, imports none."""
    parser = Parser(
        prog="equigap", description=INTRODUCTION, formatter_class=argparse.RawDescriptionHelpFormatter,
        usage="equigap COMMAND [options]", epilog=_commands() + "\n\n" + CLOSING, allow_abbrev=False,
    )  # fmt: skip
    parser.add_argument("--version", action="version", version=f"equigap {_version()}")
    return parser


def command_parser(name: str) -> tuple[Parser, Any]:
    """The parser of a command and its module, imported now."""
    command = COMMANDS[name]
    try:
        module = importlib.import_module(command.module)
    except ModuleNotFoundError as error:
        if error.name == command.module:
            raise OptionError(f"`equigap {name}` is not part of this version; choose another command") from None
        raise
    parser = Parser(
        prog=f"equigap {name}", description=getattr(module, "DESCRIPTION", command.summary.capitalize() + "."),
        formatter_class=argparse.RawDescriptionHelpFormatter, epilog=f"examples:\n  {command.examples}",
        allow_abbrev=False,
    )  # fmt: skip
    module.add_arguments(parser)
    if parser.action("--config") is None:
        parser.reads_config = True
        parser.add_argument(
            "--config", metavar="FILE.toml", help="read options from a TOML file; the command line wins"
        )
    return parser, module


def parse(arguments: Sequence[str]) -> tuple[argparse.Namespace, Any]:
    """Options of a command line that starts with a command, and the module that runs it. Raises `OptionError`."""
    name, *rest = arguments
    if name not in COMMANDS:
        raise OptionError(f"unknown command '{name}'{nearest(name, COMMANDS)}; choose from {', '.join(COMMANDS)}")
    parser, module = command_parser(name)
    _check_options(rest, parser)
    if parser.reads_config:
        for path in _config_files(rest):
            # an option in between ends lists of values, before the command line's own words
            rest = [*read_config(path, parser), f"--config={path}", *rest]
    args, unknown = parser.parse_known_args(rest)
    if unknown:
        raise OptionError(f"unexpected '{unknown[0]}'; see `{parser.prog} --help`")
    args.command = name
    if parser.reads_config:
        del args.config
    return args, module


def read_config(path: str | Path, parser: Parser) -> list[str]:
    """Options in a TOML file as command-line words; keys are option names without '--', '_' for '-' allowed.

    Raises `OptionError` for an unknown key, naming the nearest one.
    """
    try:
        content = tomllib.loads(Path(path).read_text())
    except OSError as error:
        raise OptionError(f"{path}: cannot be read ({error.strerror}); check the path after --config") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise OptionError(f"{path}: not valid TOML ({error})") from error
    words: list[str] = []
    for key, value in content.items():
        option = "--" + key.replace("_", "-")
        action = parser.action(option)
        if action is None or option in ("--config", "--help"):
            names = [name.removeprefix("--") for name in parser.options() if name not in ("--config", "--help")]
            raise OptionError(f"{path}: unknown option '{key}'{nearest(key.replace('_', '-'), names)}")
        words += _words(path, option, action, value)
    return words


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `equigap`; returns the exit code."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    try:
        if not arguments or arguments[0].startswith("-"):
            _, unknown = overview().parse_known_args(arguments)
            if unknown:
                raise OptionError(f"the first word must be a command: {', '.join(COMMANDS)}")
            overview().print_help()
            return 0 if arguments else 2
        args, module = parse(arguments)
        return int(module.main(args) or 0)
    except KeyboardInterrupt:
        return _say("interrupted; the same command goes on from the last finished step", 130)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:
        if os.environ.get("EQUIGAP_DEBUG") or not _can_be_mended(error):
            raise
        return _say(f"error: {_message(error)}", 2)


def _can_be_mended(error: Exception) -> bool:
    """Whether this is a named error of ours or of the operating system; imports nothing."""
    kinds: list[type[BaseException]] = [StudyError, OSError]
    for module, name in (
        ("calibrate.errors", "EquigapError"),
        ("forward.errors", "ForwardError"),
        ("meshes.errors", "MeshError"),
    ):
        if module in sys.modules:
            kinds.append(getattr(sys.modules[module], name))
    return isinstance(error, tuple(kinds))


def _message(error: Exception) -> str:
    """One line that says what is wrong and what to do."""
    if isinstance(error, OSError) and error.strerror:
        what = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        return what + ("; free some space and run the same command again" if full else "; check the path")
    return " ".join(str(error).split())


def _say(message: str, code: int) -> int:
    print(f"equigap: {message}", file=sys.stderr)
    return code


def _check_options(words: Sequence[str], parser: Parser) -> None:
    """Raise `OptionError` for the first long option that the command does not have."""
    for word in words:
        option = word.split("=")[0]
        if word == "--":
            return
        if word.startswith("--") and parser.action(option) is None:
            raise OptionError(
                f"unknown option {option}{nearest(option, parser.options())}; see `{parser.prog} --help`"
            )


def _config_files(words: Sequence[str]) -> list[str]:
    """Values of --config on a command line."""
    parser = Parser(add_help=False, allow_abbrev=False)
    parser.add_argument("--config")
    found = parser.parse_known_args(words)[0].config
    return [] if found is None else [found]


def _words(path: str | Path, option: str, action: argparse.Action, value: Any) -> list[str]:
    """Command-line words of one entry of a configuration file."""
    if isinstance(value, bool):
        if action.nargs != 0:
            raise OptionError(f"{path}: option '{option[2:]}' needs a value, not {str(value).lower()}")
        return [option] if value else []
    if action.nargs == 0:
        raise OptionError(f"{path}: option '{option[2:]}' is a switch; give true or false")
    if isinstance(value, dict):
        raise OptionError(f"{path}: '{option[2:]}' is a table; options stand at the top of the file")
    if isinstance(value, list):
        if action.nargs in (None, "?"):
            return [f"{option}={','.join(map(str, value))}"]
        return [option, *map(str, value)]
    return [f"{option}={value}"]


def _commands() -> str:
    width = max(map(len, COMMANDS))
    return "commands:\n" + "\n".join(f"  {name:{width}}  {c.summary}" for name, c in COMMANDS.items())


def _version() -> str:
    try:
        return metadata.version("equigap")
    except metadata.PackageNotFoundError:
        return "(not installed)"


if __name__ == "__main__":
    sys.exit(main())
