"""The machine record among the files of a folder: which file, which columns, which units.

In: tables that are no frames. Out: entries of [force] and [frames] of a column map, or questions.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibrate import errors
from studies.importers.exports.guesses import Guesses
from studies.importers.exports.picture_rows import rows_of_pictures
from studies.importers.exports.text_files import NUMBER, TextFile, plain, text_file
from studies.importers.map_tables import FORCE_UNITS, TIME_UNITS
from studies.importers.text_tables import read_table, read_words

WORD = r"(?<![^\W_])(?:{})(?![^\W_])"  # an underscore ends a word
FORCES = r"force|load|\w*kraft|last|forza|fuerza|carga|carico|força|kracht|siła|effort"
FORCE = re.compile(WORD.format(FORCES) + r"|^f_?[xy]?$", re.IGNORECASE)
TIME = re.compile(
    WORD.format(r"time|zeit|\w*zeit|temps|tempo|tiempo|tijd|czas|elapsed") + r"|^t$|timestamp", re.IGNORECASE
)
CROSSHEAD = re.compile(
    WORD.format(r"cross-?\s?head|traverse\w*|stroke|extension|displacement|\w*weg|course|desplazamiento|spostamento"),
    re.IGNORECASE,
)
MOSTLY = 0.5  # of the rows of a column, from which it holds numbers and the others are mistakes
SECONDS = {"sec": "s", "second": "s", "seconds": "s"}


@dataclass(frozen=True)
class RecordAnswers:
    """What the user says of the record."""

    file: Path | None = None
    force: str | None = None
    time: str | None = None
    force_unit: str | None = None
    time_unit: str | None = None


def say_record(others: Sequence[TextFile], answers: RecordAnswers, frames: int, found: Guesses) -> None:
    """Find file and columns of the force. frames: number of frames with a file.

    Raises `DataNotFoundError` and `FileFormatError` for a record that was named and is none.
    """
    record = _named(answers.file) if answers.file else _only_one(others, found)
    if record is None:
        return
    why = "as given" if answers.file else "the only table beside the frames with a column of forces"
    found.say("force.file", str(record.path.resolve()), why)
    _say_layout(record, found)
    force = answers.force or _column(record, FORCE, FORCE_UNITS)
    if force is None:
        found.ask(
            "force.force", "--force-column", f"which of {', '.join(record.names)} in {record.path.name} is the force"
        )
        return
    found.say("force.force", force, "as given" if answers.force else "name and unit of the column")
    _say_unit(record.unit(force), "force.unit", FORCE_UNITS, answers.force_unit, found)
    time = answers.time or _clock(record)
    untimed = found.get("frames.rate_hz") is None and found.get("frames.times_s") is None
    rest = ", and 0 N at the reference picture" if found.get("points.reference") == "separate" else ""
    picture = _pictures(record, found)
    if picture or record.rows == frames:
        why = (
            f"'{picture}' names the picture of a row"
            if picture
            else f"{record.rows} rows for {frames} frames: one each{rest}"
        )
        found.say("force.per_frame", True, why)
        if picture:
            found.say("force.picture", picture, "every frame's file has the name of one row in it")
        if time is not None and untimed:
            _say_time(record, time, answers, found)
        return
    if time is None:
        found.ask(
            "force.time",
            "--time-column",
            f"{record.path.name} has {record.rows} rows for {frames} frames, so that a time is needed: which of {', '.join(record.names)}",
        )
        return
    _say_time(record, time, answers, found)
    crosshead = _numbers(record, [name for name in record.names if CROSSHEAD.search(plain(name))])
    if crosshead is not None:
        found.say("force.crosshead", crosshead, "name of the column: where the crosshead is, in any unit")
    if untimed:
        _check_pictures(record, found)
        found.ask(
            "frames.rate_hz",
            "--frame-rate",
            "no time of the frames is stated, and the record has another number of rows",
        )


def say_channels(
    channels: Mapping[str, str], answers: RecordAnswers, others: Sequence[TextFile], found: Guesses
) -> bool:
    """The force among columns of the frames themselves; False where there are none, or where a record holds it."""
    if not channels or answers.file or any(is_record(file) for file in others):
        return False
    if answers.force is None or answers.force not in channels:
        listed = ", ".join(f"{name} ({values})" for name, values in channels.items())
        found.ask("force.force", "--force-column", f"which of {listed} is the force, or --record with a machine record")
        return True
    found.say("force.in_frames", True, "the files of the frames hold it")
    found.say("force.force", answers.force, "as given")
    found.say("force.per_frame", True, "one value a file")
    if answers.force_unit:
        found.say("force.unit", answers.force_unit, "as given")
    else:
        found.ask("force.unit", "--force-unit", f"not stated in the files: one of {', '.join(FORCE_UNITS)}")
    return True


def _pictures(record: TextFile, found: Guesses) -> str | None:
    """The column that names one picture for every frame."""
    files = found.get("points.files") or ()
    if isinstance(files, str) or not files:
        return None
    for name, rows in _rows_by_name(record, files):
        if rows and None not in rows and len(set(rows)) == len(rows):
            return name
    return None


def _check_pictures(record: TextFile, found: Guesses) -> None:
    """Raises `FileFormatError` where a column names most of the pictures, but not all."""
    files = found.get("points.files") or ()
    for name, rows in [] if isinstance(files, str) else _rows_by_name(record, files):
        if None in rows and sum(row is not None for row in rows) > len(files) / 2:
            raise errors.FileFormatError(
                f"{record.path}: '{name}' names the pictures of the rows, but none or several for {Path(files[rows.index(None)]).name}; mend its row, take its file out of the folder, or give --frame-rate"
            )


def _rows_by_name(record: TextFile, files: Sequence[str]) -> Iterator[tuple[str, list[int | None]]]:
    """Columns of words, and the row of each that names the picture of each file."""
    for name in record.names:
        words = read_words(record.path, name, record.layout)
        yield name, [] if any(map(_is_number, words)) else list(rows_of_pictures(words, files))


def _is_number(word: str) -> bool:
    return bool(NUMBER.fullmatch(word))


def _say_time(record: TextFile, time: str, answers: RecordAnswers, found: Guesses) -> None:
    found.say("force.time", time, "as given" if answers.time else "name of the column")
    _say_unit(record.unit(time), "force.time_unit", TIME_UNITS, answers.time_unit, found)


def is_record(file: TextFile) -> bool:
    """Whether a table has a column of forces."""
    return any(FORCE.search(plain(name)) for name in file.names)


def _named(path: Path) -> TextFile:
    if not path.is_file():
        raise errors.DataNotFoundError(f"{path}: no such file; give the machine record with --record")
    found = text_file(path)
    if found is None or found.is_matrix:
        raise errors.FileFormatError(
            f"{path}: no table with a header and at least two rows of numbers; export the machine record as text with named columns"
        )
    return found


def _only_one(others: Sequence[TextFile], found: Guesses) -> TextFile | None:
    """The one record of a folder; else a question."""
    records = [file for file in others if is_record(file)]
    if len(records) == 1:
        return records[0]
    several = ", ".join(file.path.name for file in records)
    found.ask(
        "force.file",
        "--record",
        f"which of {several} is the machine record"
        if records
        else "no file with a column of forces: the machine record",
    )
    return None


def _column(file: TextFile, kind: re.Pattern[str], units: dict[str, float]) -> str | None:
    """The only column of a kind, or the only one of those with a known unit."""
    named = [name for name in file.names if kind.search(plain(name))]
    if len(named) > 1:
        named = [name for name in named if _spelled(file.unit(name)) in units]
    return named[0] if len(named) == 1 else None


def _clock(file: TextFile) -> str | None:
    """The column of the time, where it holds numbers and no dates."""
    time = _column(file, TIME, TIME_UNITS)
    return _numbers(file, [time] if time else [])


def _numbers(file: TextFile, names: Sequence[str]) -> str | None:
    """The only one of some columns, if it holds numbers. Raises `FileFormatError` for a wrong row among many of them."""
    if len(names) != 1:
        return None
    try:
        return next(iter(read_table(file.path, names, file.layout)))
    except errors.FileFormatError:
        if np.mean([_is_number(word) for word in read_words(file.path, names[0], file.layout)]) > MOSTLY:
            raise
        return None


def _spelled(unit: str | None) -> str:
    return SECONDS.get((unit or "").casefold(), unit or "")


def _say_unit(stated: str | None, key: str, units: dict[str, float], given: str | None, found: Guesses) -> None:
    """As given, as stated, or the first of the known ones where none is; an unknown one is asked for."""
    unit, usual = _spelled(stated), next(iter(units))
    if given:
        found.say(key, given, "as given")
    elif unit in units:
        found.say(key, unit, "unit in the header")
    elif unit:
        option = "--force-unit" if key == "force.unit" else "--time-unit"
        found.ask(key, option, f"[{unit}] is none of {', '.join(units)}")
    else:
        found.say(key, usual, f"unit not stated; {usual} assumed, look at the picture")


def _say_layout(file: TextFile, found: Guesses) -> None:
    for key, value, usual in (
        ("delimiter", file.delimiter, ","),
        ("decimal", file.decimal, "."),
        ("comment", file.comment, ""),
        ("header_line", file.header_line, 1),
        ("units_row", bool(file.units), False),
    ):
        if value != usual:
            found.say(f"force.{key}", value, "as the file is written")
