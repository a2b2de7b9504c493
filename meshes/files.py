"""Named arrays in, one .npz file out, and back; written atomically, so that a kill leaves no half file."""

from __future__ import annotations

import contextlib
import os
import zipfile
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from meshes.errors import MeshDataError

VERSION = 1


def write_npz(path: str | Path, format_name: str, **arrays: Any) -> None:
    """Write `arrays` with the format's name and version; the folder is made. Raises `MeshDataError`."""
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(temporary, "wb") as file:
            np.savez_compressed(file, format=format_name, version=VERSION, **arrays)
        os.replace(temporary, path)
    except OSError as error:
        raise MeshDataError(f"{path}: cannot be written ({error}); choose another place or free some space") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


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
