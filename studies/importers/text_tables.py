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
# not a number: of C, .NET and MATLAB, and as .NET writes it in other languages
MISSING = {
    *("", "nan", "none", "null", "n/a", "na", "-", "-nan", "nan(ind)", "-nan(ind)", "1.#qnan", "-1.#ind", "1.#ind"),
    *("non un numero reale", "n. def.", "non numérique", "neun", "nan (niet-een-getal)", "nan (não é um número)"),
    *("nie jest liczbą", "není číslo", "nem szám", "не число", "非数字", "ej ett tal", "epäluku", "ikke et tal"),
}
DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")


@dataclass(frozen=True)
class Layout:
    """How a table is written. header_line counts from 1 and skips blank lines and comments; 0 = no header,
    columns are then named by their number from 1. units_row: a row of units follows the header. decimal: '.' or ','.
    missing_words: what else stands for a missing value, in lower case."""

    delimiter: str = ","
    header_line: int = 1
    units_row: bool = False
    comment: str = ""
    missing_allowed: bool = False
    decimal: str = "."
    missing_words: tuple[str, ...] = ()


def read_table(
    path: str | Path, columns: Sequence[str] | None = None, layout: Layout = Layout(), optional: Sequence[str] = ()
) -> dict[str, Array]:
    """Read `columns` (all by default) of a text table, and those of `optional` that it has: {name: (n_rows,)}.

    Raises `DataNotFoundError` (no such file), `DecimalCommaError` and `FileFormatError` with file and line:
    not numeric, too few or too many fields (a truncated file), column missing, no rows.
    """
    path = Path(path)
    rows = _rows(path, layout)
    names = _header(path, rows, layout)
    wanted = list(names) if columns is None else [*columns, *(name for name in optional if name in names)]
    index = [_find(path, names, name) for name in wanted]
    values: list[list[float]] = []
    for line, fields in rows[layout.header_line + layout.units_row :]:
        if len(fields) != len(names):
            raise _wrong_length(path, line, fields, len(names))
        try:
            row = [float(fields[i]) for i in index]
        except ValueError:
            row = [_number(path, line, fields[i], names[i], layout) for i in index]
        if not layout.missing_allowed and not all(map(math.isfinite, row)):
            bad = names[index[[math.isfinite(v) for v in row].index(False)]]
            raise errors.FileFormatError(f"{path}, line {line}: '{bad}' is not a finite number")
        values.append(row)
    if not values:
        raise errors.FileFormatError(f"{path}: no rows of numbers below the header; is the file truncated?")
    table = np.array(values)
    table[np.isinf(table)] = np.nan
    return {name: table[:, i] for i, name in enumerate(wanted)}


def read_words(path: str | Path, column: str, layout: Layout = Layout()) -> list[str]:
    """A column (n_rows,) as it is written. Raises as `read_table`."""
    path = Path(path)
    rows = _rows(path, layout)
    names = _header(path, rows, layout)
    index = _find(path, names, column)
    body = rows[layout.header_line + layout.units_row :]
    short = next(((line, fields) for line, fields in body if len(fields) != len(names)), None)
    if short:
        raise _wrong_length(path, *short, len(names))
    return [fields[index] for _, fields in body]


def decoded(raw: bytes) -> str:
    """Text of a file: UTF-16 with its mark, UTF-8 with or without, else Latin-1."""
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return raw.decode("utf-16")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _rows(path: Path, layout: Layout) -> list[tuple[int, list[str]]]:
    """[(line number, fields)] of all lines that are neither blank nor comments; a delimiter that ends every line ends no field."""
    if not path.is_file():
        raise errors.DataNotFoundError(f"{path}: no such file")
    rows = [
        (number, split(line, layout.delimiter))
        for number, line in enumerate(decoded(path.read_bytes()).splitlines(), 1)
        if line.strip() and not (layout.comment and line.lstrip().startswith(layout.comment))
    ]
    trailing = rows and all(len(fields) > 1 and not fields[-1] for _, fields in rows)
    return [(number, fields[:-1]) for number, fields in rows] if trailing else rows


def split(line: str, delimiter: str) -> list[str]:
    """Fields of a line without blanks around them; a blank as delimiter means any number of them."""
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


def _number(path: Path, line: int, field: str, name: str, layout: Layout) -> float:
    if DECIMAL_COMMA.fullmatch(field):
        if layout.decimal == ",":
            return float(field.replace(",", "."))
        raise errors.DecimalCommaError(
            f"{path}, line {line}: '{field}' in '{name}' has a decimal comma; export with decimal points, or set decimal = \",\" in a column map"
        )
    if field.lower() in MISSING or field.lower() in layout.missing_words:
        if layout.missing_allowed:
            return math.nan
        raise errors.FileFormatError(f"{path}, line {line}: no value in '{name}'")
    try:
        return float(field)
    except ValueError:
        raise errors.FileFormatError(
            f"{path}, line {line}: '{field}' in '{name}' is not a number; if it stands for a missing value, name it in missing_words of a column map"
        ) from None


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
