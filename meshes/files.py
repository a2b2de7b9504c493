"""Files written whole or not at all, and named arrays in a .npz file.

A kill or a full disk leaves the old file or none, never half a file. Every package writes through `atomic_path`.
"""

from __future__ import annotations

import os
import tempfile
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from meshes.errors import MeshDataError

VERSION = 1


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A temporary path beside `path`, with its suffix; it replaces `path` when the block ends without error.

    Missing folders are made. Raises `OSError` when the place cannot be written or is full.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_atomically(path: str | Path, content: bytes) -> None:
    """Write `content` to `path`, making its folder; the file appears only when it is complete. Raises `OSError`."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)


def _umask() -> int:
    mask = os.umask(0o022)
    os.umask(mask)
    return mask


def write_npz(path: str | Path, format_name: str, **arrays: Any) -> None:
    """Write `arrays` with the format's name and version; the folder is made. Raises `MeshDataError`."""
    try:
        with atomic_path(path) as temporary, open(temporary, "wb") as file:
            np.savez_compressed(file, format=format_name, version=VERSION, **arrays)
    except OSError as error:
        raise MeshDataError(f"{path}: cannot be written ({error}); choose another place or free some space") from error


def _reason(error: Exception) -> str:
    """NumPy's words, without its advice to load what may be harmful."""
    return "not an archive of arrays" if "pickle" in str(error) else str(error)


def read_npz(path: str | Path, format_name: str, required: Iterable[str]) -> dict[str, Any]:
    """Arrays of a file that `write_npz` wrote. Raises `MeshDataError` if it is missing, broken or another."""
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            content = dict(archive)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError) as error:
        raise MeshDataError(
            f"{path}: cannot be read as {format_name} ({_reason(error)}); delete it and make it again"
        ) from error
    if str(content.pop("format", "")) != format_name:
        raise MeshDataError(f"{path}: this is no {format_name} file")
    if int(content.pop("version", -1)) != VERSION:
        raise MeshDataError(f"{path}: this program reads version {VERSION} of {format_name}")
    missing = [key for key in required if key not in content]
    if missing:
        raise MeshDataError(f"{path}: {', '.join(missing)} missing; the file is damaged, write it again")
    return content


def with_prefix(content: dict[str, Any], prefix: str) -> dict[str, Any]:
    """Those entries whose names begin with a prefix, by the rest of the name."""
    return {key.removeprefix(prefix): value for key, value in content.items() if key.startswith(prefix)}
