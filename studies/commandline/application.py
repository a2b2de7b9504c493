"""The commands of `equigap` as a cyclopts application: options are read from signatures and docstrings, and from TOML."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, ArgumentCollection, CycloptsError, Parameter, UnusedCliTokensError
from cyclopts.config import Toml

from studies.commandline.option_types import nearest
from studies.commandline.outcome import Outcome
from studies.errors import OptionError

Targets = Mapping[str, tuple[str, str]]  # {name: ('module:function', examples)}


class OptionFile(Toml):
    """Options of one command at the top of a TOML file; '_' may stand for '-'.

    Raises `CycloptsError` for what is no TOML, and for an unknown option, naming the nearest.
    """

    def __call__(self, app: App, commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
        names = [name[2:] for argument in arguments for name in argument.names if name.startswith("--")]
        for key in self.config:
            option = key.replace("_", "-")
            if option not in names:
                raise CycloptsError(msg=f"{self.path}: unknown option '{key}'{nearest(option, names)}.")
        super().__call__(app, commands, arguments)

    def _load_config(self, path: Path) -> dict[str, Any]:
        try:
            return tomllib.loads(path.read_text())
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise CycloptsError(msg=f"{path}: not valid TOML ({error}).") from error


def application(targets: Targets) -> App:
    """The application of some commands; a module is imported when its command is chosen."""
    app = App(
        name="equigap", version_flags=[], result_action="return_value", suppress_keyboard_interrupt=False,
        help_format="markdown",
        default_parameter=Parameter(negative=(), allow_repeating=True, show_default=_default),
    )  # fmt: skip
    for name, (target, examples) in targets.items():
        app.command(target, name=name, help_epilogue=f"examples:\n```\n{examples}\n```")

    app.meta.suppress_keyboard_interrupt = False

    @app.meta.default
    def launch(
        *words: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
        config: Annotated[Path | None, Parameter(help="read options from a TOML file; the command line wins")] = None,
    ) -> Outcome | None:
        app.config = () if config is None else (OptionFile(config, must_exist=True, use_commands_as_keys=False),)
        return app(words, exit_on_error=False, print_error=False)

    return app


def _default(value: Any) -> str | None:
    """How a default is shown in the help; nothing for a switch, None or an empty list."""
    if value is None or value is False or value == ():
        return None
    return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)


def run(targets: Targets, words: Sequence[str]) -> Outcome | None:
    """Run a command line whose first word is a command; None where it asked for help. Raises `OptionError`."""
    with _mendable(words[0]):
        return application(targets).meta(words, exit_on_error=False, print_error=False, result_action="return_value")


def parse(targets: Targets, words: Sequence[str]) -> dict[str, Any]:
    """Arguments that a command line gives to the function of its command, defaults included; it is not called. Raises `OptionError`."""
    with _mendable(words[0]):
        _, bound, _ = application(targets).parse_args(words, exit_on_error=False, print_error=False)
    bound.apply_defaults()
    return dict(bound.arguments)


@contextmanager
def _mendable(command: str) -> Iterator[None]:
    """Errors of cyclopts as `OptionError`, in one line."""
    try:
        yield
    except CycloptsError as error:
        message = " ".join(str(error).split()).rstrip(".")
        if isinstance(error, UnusedCliTokensError):
            message += ". Values of one option are joined by commas (left,right); a path with spaces is in quotes"
        raise OptionError(f"{message}; see `equigap {command} --help`") from error
