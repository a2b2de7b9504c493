"""Parsing for `equigap`: errors in one line with the nearest option there is, and options from a TOML file."""

from __future__ import annotations

import argparse
import importlib
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from studies.commands.options import nearest
from studies.errors import OptionError


class Parser(argparse.ArgumentParser):
    """Errors in one line, with the nearest option there is. reads_config: whether --config is handled here."""

    reads_config = False

    def error(self, message: str) -> NoReturn:
        """Raise `OptionError`, which names what is wrong, instead of leaving the program."""
        raise OptionError(f"{message}; see `{self.prog} --help`")

    def options(self) -> list[str]:
        """Long options, such as '--output'."""
        return [name for action in self._actions for name in action.option_strings if name.startswith("--")]

    def action(self, option: str) -> argparse.Action | None:
        """The action behind an option such as '--output'."""
        return next((a for a in self._actions if option in a.option_strings), None)


def check_options(words: Sequence[str], parser: Parser) -> None:
    """Raise `OptionError` for the first long option that the command does not have."""
    for word in words:
        option = word.split("=")[0]
        if word == "--":
            return
        if word.startswith("--") and parser.action(option) is None:
            raise OptionError(f"unknown option {option}{nearest(option, parser.options())}; see `{parser.prog} --help`")


def config_files(words: Sequence[str]) -> list[str]:
    """Values of --config on a command line."""
    parser = Parser(add_help=False, allow_abbrev=False)
    parser.add_argument("--config")
    found = parser.parse_known_args(words)[0].config
    return [] if found is None else [found]


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


def run(name: str, command: Any, words: Sequence[str]) -> None:
    """Run a command that has `add_arguments(parser)` and `main(args)`. Raises `OptionError`."""
    module = importlib.import_module(command.target)
    parser = Parser(
        prog=f"equigap {name}", description=getattr(module, "DESCRIPTION", command.summary.capitalize() + "."),
        formatter_class=argparse.RawDescriptionHelpFormatter, epilog=f"examples:\n  {command.examples}",
        allow_abbrev=False,
    )  # fmt: skip
    module.add_arguments(parser)
    parser.add_argument("--config", metavar="FILE.toml", help="read options from a TOML file; the command line wins")
    rest = list(words)
    check_options(rest, parser)
    for path in config_files(rest):
        rest = [*read_config(path, parser), f"--config={path}", *rest]
    args, unknown = parser.parse_known_args(rest)
    if unknown:
        raise OptionError(f"unexpected '{unknown[0]}'; see `{parser.prog} --help`")
    args.command = name
    del args.config
    module.main(args)
