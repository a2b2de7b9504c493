"""Files written whole, and model files read with named errors.

Bytes in, a whole file out: a kill or a full disk leaves the old file or none, never half a file.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from calibrate import errors


def write_atomically(path: str | Path, content: bytes) -> None:
    """Write `content` to `path`, making its folder; the file appears only when it is complete."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(content)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def read_model[T](
    path: str | Path,
    build: Callable[[dict[str, Any]], T],
    form: str,
    version: int,
    command: str,
    others: Mapping[str, str] | None = None,
) -> T:
    """What `build` makes of the JSON in a model file of the format `form`, which `command` writes.

    others: what to say of files of other formats. Raises `DataNotFoundError`, `ModelFileError` naming the key that is wrong.
    """
    path = Path(path)
    if not path.exists():
        raise errors.DataNotFoundError(f"{path}: no such model file; `{command}` writes one")
    try:
        content = json.loads(path.read_text())
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise errors.ModelFileError(
            f"{path}: not a JSON model file ({error}); give the model.json of `equigap calibrate` or `equigap discover`"
        ) from error
    found = content.get("format") if isinstance(content, dict) else None
    if found != form:
        known = (others or {}).get(str(found), f"'format' is not '{form}'; give the model.json that `{command}` writes")
        raise errors.ModelFileError(f"{path}: {known}")
    if content.get("version") != version:
        raise errors.ModelFileError(f"{path}: version {content.get('version')}, this program reads {version}")
    try:
        return build(content)
    except KeyError as error:
        raise errors.ModelFileError(f"{path}: key {error} is missing") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise errors.ModelFileError(f"{path}: {error}") from error
