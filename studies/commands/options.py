"""Options that several commands share, so that they look and read the same everywhere."""

from __future__ import annotations

import argparse
import difflib
from collections.abc import Iterable
from pathlib import Path

from studies.errors import OptionError


def add_output(parser: argparse.ArgumentParser, default: str) -> None:
    """`--output` (None stands for results/`default`, or results/`default`-quick) and `--overwrite`."""
    group = parser.add_argument_group("output")
    group.add_argument("-o", "--output", type=Path, metavar="FOLDER", help=f"(default: results/{default})")
    group.add_argument("--overwrite", action="store_true", help="replace an earlier run in that folder")


def output_folder(args: argparse.Namespace, default: str) -> Path:
    """The folder that `add_output` left to choose."""
    quick = "-quick" if getattr(args, "quick", False) else ""
    return args.output or Path("results") / (default + quick)


def positive(text: str) -> float:
    """A finite number > 0, for `type=`."""
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"'{text}' must be a number above 0")
    return value


def count(text: str) -> int:
    """A whole number >= 1, for `type=`."""
    value = int(text) if text.strip().lstrip("+-").isdigit() else 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"'{text}' must be a whole number of at least 1")
    return value


def seed(text: str) -> int:
    """A whole number >= 0, for `type=`."""
    value = int(text) if text.strip().lstrip("+").isdigit() else -1
    if value < 0:
        raise argparse.ArgumentTypeError(f"'{text}' must be a whole number of at least 0")
    return value


def settings(args: argparse.Namespace, *left_out: str) -> dict[str, object]:
    """What fixes the results: all options but the output folder, the number of jobs and `left_out`."""
    ignored = {"output", "overwrite", "jobs", *left_out}
    return {key: value for key, value in sorted(vars(args).items()) if key not in ignored}


def nearest(word: str, words: Iterable[str]) -> str:
    """'; did you mean X?', or nothing when no word is near."""
    found = difflib.get_close_matches(word, list(words), n=1, cutoff=0.5)
    return f"; did you mean {found[0]}?" if found else ""


def assignments(words: Iterable[str]) -> dict[str, float]:
    """{'mu': 0.3} of ('mu=0.3',). Raises `OptionError`."""
    try:
        return {name: float(value) for name, _, value in (word.partition("=") for word in words)}
    except ValueError:
        raise OptionError(f"{', '.join(words)}: write NAME=VALUE, such as mu=0.3") from None
