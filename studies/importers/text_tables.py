"""Text tables of numbers (CSV and its relatives) with errors that name file and line.

In: a path and how the table is written. Out: {column name: (n_rows,) numbers}, NaN where a value is missing.
"""

from __future__ import annotations

import csv
import difflib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrate import errors

Array = NDArray[np.float64]
MISSING = {"", "nan", "none", "null", "n/a", "na", "-"}
DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")


@dataclass(frozen=True)
class Layout:
    """How a table is written. header_line counts from 1 and skips blank lines and comments; 0 = no header,
    columns are then named by their number from 1. units_row: a row of units follows the header."""

    delimiter: str = ","
    header_line: int = 1
    units_row: bool = False
    comment: str = ""
    missing_allowed: bool = False


def read_table(path: str | Path, columns: Sequence[str] | None = None, layout: Layout = Layout()) -> dict[str, Array]:
    """Read `columns` (all by default) of a text table: {name: (n_rows,)}.

    Raises `DataNotFoundError` (no such file), `DecimalCommaError` and `FileFormatError` with file and line:
    not numeric, too few or too many fields (a truncated file), column missing, no rows.
    """
    path = Path(path)
    rows = _rows(path, layout)
    names = _header(path, rows, layout)
    wanted = list(names if columns is None else columns)
    index = [_find(path, names, name) for name in wanted]
    values: list[list[float]] = []
    for line, fields in rows[layout.header_line + layout.units_row :]:
        if len(fields) != len(names):
            raise _wrong_length(path, line, fields, len(names))
        try:
            row = [float(fields[i]) for i in index]
        except ValueError:
            row = [_number(path, line, fields[i], names[i], layout.missing_allowed) for i in index]
        if not layout.missing_allowed and not all(map(math.isfinite, row)):
            bad = names[index[[math.isfinite(v) for v in row].index(False)]]
            raise errors.FileFormatError(f"{path}, line {line}: '{bad}' is not a finite number")
        values.append(row)
    if not values:
        raise errors.FileFormatError(f"{path}: no rows of numbers below the header; is the file truncated?")
    table = np.array(values)
    table[np.isinf(table)] = np.nan
    return {name: table[:, i] for i, name in enumerate(wanted)}


def _rows(path: Path, layout: Layout) -> list[tuple[int, list[str]]]:
    """[(line number, fields)] of all lines that are neither blank nor comments."""
    if not path.is_file():
        raise errors.DataNotFoundError(f"{path}: no such file")
    raw = path.read_bytes()
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    return [
        (number, _split(line, layout.delimiter))
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not (layout.comment and line.lstrip().startswith(layout.comment))
    ]


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter.isspace() and delimiter != "\t":
        return line.split()
    if '"' not in line:
        return [field.strip() for field in line.split(delimiter)]
    return [field.strip() for field in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]


def _header(path: Path, rows: list[tuple[int, list[str]]], layout: Layout) -> list[str]:
    if len(rows) < max(layout.header_line, 1):
        raise errors.FileFormatError(f"{path}: no header in line {layout.header_line}; the file is empty or truncated")
    if layout.header_line == 0:
        return [str(i + 1) for i in range(len(rows[0][1]))]
    return rows[layout.header_line - 1][1]


def _find(path: Path, names: list[str], name: str) -> int:
    if names.count(name) == 1:
        return names.index(name)
    close = difflib.get_close_matches(name, names, 1)
    hint = f"; did you mean '{close[0]}'?" if close else ""
    if len(names) == 1 and name not in names:
        hint += "; only one column was found: is the delimiter right?"
    raise errors.FileFormatError(
        f"{path}: {names.count(name) or 'no'} column{'s' if names.count(name) > 1 else ''} named '{name}'{hint} (columns: {', '.join(names[:12])})"
    )


def _number(path: Path, line: int, field: str, name: str, missing_allowed: bool) -> float:
    if DECIMAL_COMMA.fullmatch(field):
        raise errors.DecimalCommaError(
            f"{path}, line {line}: '{field}' in '{name}' has a decimal comma; export with decimal points"
        )
    if field.lower() in MISSING:
        if missing_allowed:
            return math.nan
        raise errors.FileFormatError(f"{path}, line {line}: no value in '{name}'")
    try:
        return float(field)
    except ValueError:
        raise errors.FileFormatError(f"{path}, line {line}: '{field}' in '{name}' is not a number") from None


def _wrong_length(path: Path, line: int, fields: list[str], expected: int) -> errors.FileFormatError:
    if len(fields) < expected:
        return errors.FileFormatError(
            f"{path}, line {line}: {len(fields)} fields where the header has {expected}; is the file truncated?"
        )
    if len(fields) == 2 * expected and all(re.fullmatch(r"[-+]?\d+", f) for f in fields[::2]):
        return errors.DecimalCommaError(
            f"{path}, line {line}: {len(fields)} fields where the header has {expected}, as decimal commas make; "
            "export with decimal points"
        )
    return errors.FileFormatError(
        f"{path}, line {line}: {len(fields)} fields where the header has {expected}; "
        "stray delimiters or decimal commas?"
    )
