"""Output folders that are never overwritten silently.

In: a path and the settings that fix the results. Out: the folder, new or resumed; `run.json` in it holds the
settings, by which a later run recognises its own work, and the answer of a run that came to its end.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from studies.errors import OutputFolderError, OutputWriteError
from studies.output.manifest import made_by
from studies.output.writing import plain, write_error, write_json

RUN_FILE, MANIFEST = "run.json", "report.json"
CHECKPOINT = "checkpoint.pickle"  # of a run that has not come to its end
HERE = "{folder}/"  # in lines that are kept, the folder itself
FORMAT = "equigap-run"


def open_output_folder(path: str | Path, overwrite: bool, resume_key: Mapping[str, Any]) -> Path:
    """Make, resume or (with `overwrite`) empty an output folder, and return its path.

    resume_key: every setting that changes the results, free JSON, with the name of its "study" or "command"; the number of
    jobs does not belong to it. Absent or empty: made. Written with the same resume_key: resumed, its files are kept.
    Otherwise `OutputFolderError`. `overwrite` empties only a folder that an earlier run of the same study or command made.
    Raises `OutputWriteError` where nothing can be written.
    """
    path, settings = Path(path), plain(resume_key)
    if path.exists() and not path.is_dir():
        raise OutputFolderError(f"{path}: is a file; choose a folder with --output")
    try:
        occupied = path.is_dir() and any(path.iterdir())
    except OSError as error:
        raise write_error(path, error) from error
    if occupied:
        earlier = _read_settings(path)
        if _maker(earlier) != _maker(settings):
            raise OutputFolderError(
                f"{path}: holds results of another command ({_maker(earlier)}); choose another folder with --output"
            )
        if overwrite:
            _empty(path)
        elif earlier == settings:
            if earlier_answer(path) is None:
                print(f"equigap: going on in {path}", file=sys.stderr)
            return path
        else:
            raise OutputFolderError(
                f"{path}: holds a run with other settings ({_difference(earlier, settings)}); "
                "add --overwrite to replace it or choose another folder with --output"
            )
    write_json(path / RUN_FILE, {"format": FORMAT, "key": key_hash(settings), "settings": settings})
    return path


def complete(path: Path, answer: Iterable[str]) -> None:
    """Keep what a terminal shows of a run that came to its end. Raises `OutputWriteError`."""
    content = json.loads((path / RUN_FILE).read_text())
    lines = [line.replace(f"{path}/", HERE) for line in answer]
    write_json(path / RUN_FILE, {**content, "answer": lines, "made_by": made_by()})


def earlier_answer(path: Path) -> tuple[str, ...] | None:
    """What a run that came to its end has shown, and whether other code made it; None where none did, or where a file that its manifest ``report.json`` lists is gone."""
    try:
        content, manifest = (json.loads((path / name).read_text()) for name in (RUN_FILE, MANIFEST))
    except (FileNotFoundError, ValueError):
        return None
    if "answer" not in content or not all((path / name).exists() for name in manifest["outputs"]):
        return None
    other = "" if content["made_by"] == made_by() else ", by another version of the code or of its packages"
    first = f"{path} is complete{other}; --overwrite makes it again"
    return (first, *(line.replace(HERE, f"{path}/") for line in content["answer"]))


@contextmanager
def released_if_refused(path: Path) -> Iterator[None]:
    """A command that an error ends before it has made anything but a checkpoint leaves its folder free for another one, unless it may go on: there was
    no memory, or no space."""
    try:
        yield
    except (MemoryError, OSError, OutputWriteError):
        raise
    except Exception:
        left = [child for child in path.iterdir() if child.name != RUN_FILE]
        if all(child.name.lstrip(".").startswith(Path(CHECKPOINT).stem) for child in left):
            for child in (*left, path / RUN_FILE):
                child.unlink()
        raise


def key_hash(settings: Any) -> str:
    """Short hash of settings, the same for the same content in any order."""
    text = json.dumps(plain(settings), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _read_settings(path: Path) -> dict[str, Any]:
    """Settings of the run that made the folder. Raises `OutputFolderError` where none did."""
    try:
        content = json.loads((path / RUN_FILE).read_text())
        if content["format"] == FORMAT and isinstance(content["settings"], dict):
            return content["settings"]
    except ValueError as error:
        raise OutputFolderError(
            f"{path / RUN_FILE}: cannot be read, so the folder is left alone; delete it if it is a damaged run, or choose "
            "another one with --output"
        ) from error
    except (OSError, KeyError, TypeError):
        pass
    raise OutputFolderError(
        f"{path}: is not empty and was not made by equigap, so it is left alone; choose another folder with --output"
    )


def _maker(settings: Mapping[str, Any]) -> str:
    return str(settings.get("study") or settings.get("command") or "unknown")


def _empty(path: Path) -> None:
    """Delete the content, the run file last: an interrupted deletion can be taken up again."""
    try:
        for child in path.iterdir():
            if child.name == RUN_FILE:
                continue
            if child.is_dir() and not child.is_symlink():
                shutil.rmtree(child)
            else:
                child.unlink()
        (path / RUN_FILE).unlink()
    except OSError as error:
        raise write_error(path, error) from error


def _difference(earlier: dict[str, Any], now: dict[str, Any]) -> str:
    """'seeds: 10 there, 20 now' for up to three settings that differ; of lists the entries that do."""
    names = [name for name in {**earlier, **now} if earlier.get(name) != now.get(name)]
    words = []
    for name in names[:3]:
        there, here = earlier.get(name), now.get(name)
        if isinstance(there, list) and isinstance(here, list):
            there, here = ([one for one in some if one not in rest] for some, rest in ((there, here), (here, there)))
        words.append(f"{name}: {_short(there)} there, {_short(here)} now")
    return "; ".join(words + (["..."] if len(names) > 3 else []))


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."
