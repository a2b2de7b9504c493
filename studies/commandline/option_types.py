"""Types of options that several commands share: how a value is read from words or TOML, and what is refused.

`Count`, `NonNegative`, `Seed`, `Positive`: numbers within their range. `Names`, `Integers`, `Numbers`: values with commas between, or a TOML
list. `Assignments`: NAME=VALUE. `Repeated`: an option that may be given several times. `Several`: an option with one or more values after it.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter, Token


def nearest(word: str, words: Iterable[str]) -> str:
    """'; did you mean X?', or nothing when no word is near."""
    found = difflib.get_close_matches(word, list(words), n=1, cutoff=0.5)
    return f"; did you mean {found[0]}?" if found else ""


def default_folder(command: str, quick: bool = False) -> Path:
    """``results/COMMAND``, or ``results/COMMAND-quick``: where a command writes unless told; no blanks or slashes in it."""
    name = re.sub(r"[^\w.-]+", "-", command).strip("-")
    return Path("results") / (f"{name}-quick" if quick else name)


def within(requirement: str, holds: Callable[[Any], bool]) -> Callable[[type, Any], None]:
    """A validator of cyclopts that refuses a value that does not hold."""

    def validate(_: type, value: Any) -> None:
        if value is not None and not holds(value):
            raise ValueError(f"Must be {requirement}.")

    return validate


def _whole(_: type, tokens: Sequence[Token]) -> int:
    try:
        return int(tokens[-1].value)
    except ValueError:
        raise ValueError(f"'{tokens[-1].value}' must be a whole number") from None


def _listed(read: Callable[[str], Any], form: str) -> Callable[[type, Sequence[Token]], tuple[Any, ...]]:
    """Reads values with commas between."""

    def convert(_: type, tokens: Sequence[Token]) -> tuple[Any, ...]:
        words = [word.strip() for token in tokens for word in token.value.split(",") if word.strip()]
        try:
            return tuple(read(word) for word in words)
        except ValueError:
            text = ",".join(token.value for token in tokens)
            raise ValueError(f"'{text}': write {form}") from None

    return convert


def _count_or_list(_: type, tokens: Sequence[Token]) -> Literal["all"] | int | tuple[int, ...]:
    text = ",".join(token.value for token in tokens)
    if text == "all":
        return "all"
    try:
        numbers = tuple(int(word) for word in text.split(",") if word.strip())
    except ValueError:
        numbers = ()
    if not numbers:
        raise ValueError(f"'{text}': write all, a number, or numbers with commas between")
    return numbers if "," in text else numbers[0]


def _assignment(word: str) -> tuple[str, float]:
    name, _, value = word.partition("=")
    return name.strip(), float(value)


def _list_parameter(read: Callable[[str], Any], form: str) -> Parameter:
    return Parameter(converter=_listed(read, form), n_tokens=1, consume_multiple=False)


CountOrList = Annotated[
    Literal["all"] | int | tuple[int, ...], Parameter(converter=_count_or_list, n_tokens=1, consume_multiple=False)
]
Pictures = Annotated[
    Literal["all"] | int | tuple[int, ...] | None,
    Parameter(
        converter=_count_or_list, n_tokens=1, consume_multiple=False,
        help="of the Experiment that are used: all, how many, evenly spread, or numbers with commas between (default: as many as are affordable)",
    ),
]  # fmt: skip
Count = Annotated[int, Parameter(converter=_whole, validator=within("a whole number of at least 1", lambda n: n >= 1))]
NonNegative = Annotated[
    int, Parameter(converter=_whole, validator=within("a whole number of at least 0", lambda n: n >= 0))
]
Seed = NonNegative
Positive = Annotated[float, Parameter(validator=within("a number above 0", lambda x: 0 < x < math.inf))]
Integers = Annotated[tuple[int, ...], _list_parameter(int, "whole numbers with commas between, such as 4,4")]
Numbers = Annotated[tuple[float, ...], _list_parameter(float, "numbers with commas between, such as 10,20")]
Names = Annotated[tuple[str, ...], _list_parameter(str, "names with commas between")]
Repeated = tuple[str, ...]
Several = Annotated[tuple[str, ...], Parameter(consume_multiple=True)]
OutputFolder = Annotated[
    Path | None, Parameter(alias="-o", help="folder (default: results/COMMAND; with --quick: results/COMMAND-quick)")
]
Overwrite = Annotated[bool, Parameter(help="replace an earlier run in that folder")]
Assignments = Annotated[
    tuple[tuple[str, float], ...],
    Parameter(converter=_listed(_assignment, "NAME=VALUE, such as mu=0.3"), n_tokens=1, consume_multiple=False),
]
