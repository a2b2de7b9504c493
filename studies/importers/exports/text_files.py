"""How a text table is written, found from its content: lines before the header, separator, decimal mark, names, units.

In: a path. Out: a `TextFile`, or None where it is no table of numbers.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from studies.importers.text_tables import MISSING, Layout, decoded, split

NUMBER = re.compile(r"[-+]?(\d+[.,]?\d*|[.,]\d+)([eEdD][-+]?\d+)?")
UNIT = re.compile(r"\s*[\[(]\s*([^\])]*?)\s*[\])]\s*(?:-.*)?$")
SUFFIX = re.compile(r"(?:[_/,]| in) ?(kN|mN|N|kgf|gf|lbf|ms|s|sec|mm|cm|um|µm|px|pixel)$")  # of names such as force_kN
START, SAMPLE = 1 << 18, 60  # bytes and lines that are looked at


@dataclass(frozen=True)
class TextFile:
    """A table. names: of its columns, none for a matrix; before: lines above the header, comments too; units: of a row of its own."""

    path: Path
    names: tuple[str, ...]
    before: tuple[str, ...]
    delimiter: str
    decimal: str
    comment: str
    header_line: int
    columns: int
    units: tuple[str, ...] = ()

    @property
    def is_matrix(self) -> bool:
        """Whether it has numbers alone."""
        return self.header_line == 0

    @property
    def layout(self) -> Layout:
        """To read it with."""
        return Layout(self.delimiter, self.header_line, bool(self.units), self.comment, True, self.decimal)

    @cached_property
    def rows(self) -> int:
        """Number of rows of numbers."""
        lines = decoded(self.path.read_bytes()).splitlines()
        known = [
            line for line in lines if line.strip() and not (self.comment and line.lstrip().startswith(self.comment))
        ]
        return len(known) - self.header_line - bool(self.units)

    def unit(self, name: str) -> str | None:
        """Unit of a column, from brackets behind its name or the row of units."""
        found = UNIT.search(name)
        if not found and self.units and name in self.names:
            return self.units[self.names.index(name)].strip("()[] ") or None
        found = found or SUFFIX.search(name)
        return found.group(1) if found else None

    def column(self, *plain: str) -> str | None:
        """The first of these names that the table has, units in brackets and upper case aside."""
        for wanted in plain:
            for name in self.names:
                if UNIT.sub("", name).casefold() == wanted.casefold():
                    return name
        return None

    def stated(self, pattern: str) -> str | None:
        """First group of a pattern in the lines above the header."""
        found = next((m for m in (re.search(pattern, line) for line in self.before) if m), None)
        return found.group(1).strip() if found else None


def plain(name: str) -> str:
    """Name of a column without its unit."""
    return SUFFIX.sub("", UNIT.sub("", name)).strip()


def text_file(path: Path) -> TextFile | None:
    """What a file is, by its beginning; None for what holds no table."""
    with path.open("rb") as file:
        raw = file.read(START)
    if b"\0" in raw and not raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return None
    lines = decoded(raw[: len(raw) // 2 * 2]).splitlines()
    lines = [line for line in (lines[:-1] if len(raw) == START else lines) if line.strip()]
    comment = next((c for c in ("***", "#", "%", "//") if lines and lines[0].lstrip().startswith(c)), "")
    body = [line for line in lines if not comment or not line.lstrip().startswith(comment)]
    notes = tuple(line for line in lines if comment and line.lstrip().startswith(comment))
    delimiter = _delimiter(body[-SAMPLE:])
    if delimiter is None:
        return None
    rows = [_fields(line, delimiter) for line in body]
    width = Counter(len(row) for row in rows[-SAMPLE:]).most_common(1)[0][0]
    first = next((i for i, row in enumerate(rows) if len(row) == width and _numeric(row, delimiter)), None)
    if first is None:
        return None
    while first > 0 and len(rows[first - 1]) == width and _numeric(rows[first - 1], delimiter):
        first -= 1
    above = [i for i in range(first) if len(rows[i]) == width]
    header = above[0] if above else None
    units = tuple(rows[first - 1]) if header is not None and header < first - 1 else ()
    names = tuple(rows[header]) if header is not None else ()
    tokens = [field for row in rows[first : first + SAMPLE] for field in row]
    decimal = "," if any("," in t for t in tokens if NUMBER.fullmatch(t)) else "."  # between commas: in quotes
    before = notes + tuple(body[: header if header is not None else first])
    return TextFile(path, names, before, delimiter, decimal, comment, 0 if header is None else header + 1, width, units)


def _delimiter(lines: list[str]) -> str | None:
    """The separator that cuts most lines into the same number of fields, at least two."""
    best: tuple[int, int, str] | None = None
    for delimiter in (";", "\t", ",", " "):
        rows = [_fields(line, delimiter) for line in lines]
        counts = Counter(len(row) for row in rows if len(row) > 1 and _numeric(row, delimiter))
        if counts:
            width, often = counts.most_common(1)[0]
            if best is None or often > best[0]:
                best = (often, width, delimiter)
    return best[2] if best and best[0] >= min(2, len(lines)) else None


def _fields(line: str, delimiter: str) -> list[str]:
    found = split(line, delimiter)
    return found[:-1] if len(found) > 1 and not found[-1] and line.rstrip().endswith(delimiter) else found


def _numeric(row: list[str], delimiter: str) -> bool:
    """Whether a row has numbers and is otherwise blank or not a number; text in few fields (a name of a picture) is allowed."""
    numbers = sum(bool(NUMBER.fullmatch(field)) for field in row)
    words = sum(field.casefold() not in MISSING for field in row) - numbers
    return numbers > 0 and words <= 2 and 2 * words <= len(row)
