"""Everything that is written to disk goes through here: whole or not at all, with a record of how it came about.

In: results and the settings of the run. Out: files written atomically, a manifest NAME.json beside each figure
or table, and output folders (`studies.output.folder`) that are never overwritten silently.
"""

from __future__ import annotations

import csv
import errno
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from meshes import files
from studies.errors import OutputWriteError

FULL = (errno.ENOSPC, errno.EDQUOT)


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A temporary path beside `path`, with its suffix; it replaces `path` when the block ends without error.

    Missing folders are made. Raises `OutputWriteError` when the place cannot be written or is full.
    """
    try:
        with files.atomic_path(path) as temporary:
            yield temporary
    except OSError as error:
        raise write_error(path, error) from error


def write_error(path: str | Path, error: OSError) -> OutputWriteError:
    """`OutputWriteError` that says what to do about an `OSError` met while writing `path`."""
    if isinstance(error, OutputWriteError):
        return error
    if error.errno in FULL:
        remedy = "free some space and run the same command again, it resumes"
    else:
        remedy = "choose another folder with --output"
    return OutputWriteError(f"{path}: cannot be written ({error.strerror or error}); {remedy}")


def write_bytes(path: str | Path, content: bytes) -> None:
    """Write `content` atomically. Raises `OutputWriteError`."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: str | Path, content: str) -> None:
    """Write UTF-8 text atomically. Raises `OutputWriteError`."""
    write_bytes(path, content.encode())


def write_json(path: str | Path, content: Any) -> None:
    """Write JSON atomically; arrays become lists, NaN and infinity null. Raises `OutputWriteError`."""
    write_text(path, json.dumps(plain(content), indent=1, allow_nan=False, ensure_ascii=False) + "\n")


def write_npz(path: str | Path, **arrays: Any) -> None:
    """Write a compressed .npz without pickles atomically. Raises `OutputWriteError`."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    write_bytes(path, buffer.getvalue())


def write_csv(
    path: str | Path, columns: Sequence[str], rows: Iterable[Sequence[Any]], comments: Sequence[str] = ()
) -> None:
    """Write a table atomically; `comments` are lines above the header that start with '#'.

    Numbers keep ten digits; None becomes an empty cell. Raises `OutputWriteError`.
    """
    buffer = io.StringIO()
    for comment in comments:
        buffer.write(f"# {comment}\n")
    table = csv.writer(buffer, lineterminator="\n")
    table.writerow(columns)
    for row in rows:
        table.writerow([format(x, ".10g") if isinstance(x, float | np.floating) else x for x in row])
    write_text(path, buffer.getvalue())


def write_figure(path: str | Path, figure: Any, **options: Any) -> None:
    """Save a matplotlib figure atomically; the suffix chooses the format. Raises `OutputWriteError`."""
    with atomic_path(path) as temporary:
        figure.savefig(temporary, **options)


def plain(content: Any) -> Any:
    """`content` in terms of JSON: dict, list, str, int, float, bool, None."""
    if isinstance(content, Mapping):
        return {str(key): plain(value) for key, value in content.items()}
    if isinstance(content, np.ndarray):
        return plain(content.tolist())
    if isinstance(content, list | tuple | set | frozenset):
        return [plain(value) for value in content]
    if isinstance(content, np.generic):
        return plain(content.item())
    if isinstance(content, float):
        return content if np.isfinite(content) else None
    if content is None or isinstance(content, str | int):
        return content
    return str(content)
