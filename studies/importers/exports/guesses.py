"""What was found in a folder of exports: entries of a column map, each with its reason, and questions that are left.

In: what a vendor and the content of files say. Out: a column map as nested tables, its text with the reasons as comments, and the
error that asks for what is missing.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from calibrate import errors

type Value = str | float | int | bool | Sequence[Any] | Mapping[str, Any]
FOLDERS = ("points.folder", "force.file")  # are relative to the column map
WIDE = 100


@dataclass(frozen=True)
class Question:
    """Something that the data do not say. key: of the column map; option: of the command; why: what is missing."""

    key: str
    option: str
    why: str


class Undecided(errors.UndecidedError):
    """Carries what was found so far, so that it can be written down."""

    def __init__(self, guesses: Guesses, place: str, draft: Path | None = None) -> None:
        self.guesses, self.place = guesses, place
        asked = "; ".join(f"{q.option} ({q.key}): {q.why}" for q in guesses.questions)
        written = f". What was found is in {draft}" if draft else ""
        super().__init__(f"{place}: not stated by the data, please give: {asked}{written}")

    def written(self, draft: Path) -> Undecided:
        """The same, saying where the column map so far is."""
        return Undecided(self.guesses, self.place, draft)


@dataclass
class Guesses:
    """entries: {key with dots: (value, reason)}; facts: what else was found; questions: what was not."""

    entries: dict[str, tuple[Value, str]] = field(default_factory=dict)
    facts: list[str] = field(default_factory=list)
    questions: list[Question] = field(default_factory=list)

    def say(self, key: str, value: Value, why: str) -> None:
        """An entry of the column map; a later one replaces it."""
        self.entries[key] = (value, why)

    def ask(self, key: str, option: str, why: str) -> None:
        """Something that has to be given."""
        self.questions.append(Question(key, option, why))

    def get(self, key: str) -> Any:
        """Value of an entry, None where there is none."""
        return self.entries[key][0] if key in self.entries else None

    def tables(self) -> dict[str, Any]:
        """The column map as nested tables."""
        found: dict[str, Any] = {}
        for key, (value, _) in self.entries.items():
            *tables, last = key.split(".")
            place = found
            for table in tables:
                place = place.setdefault(table, {})
            place[last] = value
        return found

    def lines(self) -> Iterator[str]:
        """Every entry and fact with its reason; lists shortened."""
        for key, (value, why) in self.entries.items():
            text = _toml(value)
            yield f"{key} = {text if len(text) <= WIDE else text[: WIDE - 4] + ' ...'}: {why}"
        yield from self.facts

    def toml(self, folder: Path) -> str:
        """A column map for a file in `folder`; questions are left as comments."""
        lines = [
            "# Column map (docs/import.md), as found by `equigap import`; change what is wrong and import this file."
        ]
        lines += [f"# {fact}" for fact in self.facts]
        table = ""
        for key, (value, why) in sorted(self.entries.items(), key=lambda item: _place(item[0])):
            *tables, last = key.split(".")
            if ".".join(tables) != table:
                table = ".".join(tables)
                lines += ["", f"[{table}]"]
            shown = os.path.relpath(str(value), folder) if key in FOLDERS else value
            lines.append(f"{last} = {_toml(shown)}  # {why}")
        lines += [f"# missing: {q.key} ({q.option}): {q.why}" for q in self.questions]
        return "\n".join(lines) + "\n"


TABLES = ("", "points", "frames", "force", "edges", "mask", "noise", "recording")


def _place(key: str) -> int:
    return TABLES.index(key.rpartition(".")[0])


def _toml(value: Any) -> str:
    match value:
        case bool():
            return str(value).lower()
        case str():
            return json.dumps(value, ensure_ascii=False)
        case int() | float():
            return repr(value)
        case Mapping():
            return "{" + ", ".join(f"{key} = {_toml(one)}" for key, one in value.items()) + "}"
        case _:
            return "[" + ", ".join(_toml(one) for one in value) + "]"
