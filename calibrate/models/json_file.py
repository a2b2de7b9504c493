"""JSON files of models, written whole and read with named errors.

In: a path and the formats that may be there. Out: a model. Every error names the file and says what to do.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibrate import errors
from meshes.files import write_atomically

UNITS = ("MPa", "N/mm")
MEASURED, NOMINAL = "measured", "nominal"  # where the level of the stresses is from


@dataclass(frozen=True)
class Format[T]:
    """A kind of model file: its 'format' and 'version', the command that writes it, and what builds a model of it.

    build raises KeyError, TypeError, ValueError or AttributeError for a wrong content. mistaken: formats often given
    instead, with what to say of them.
    """

    name: str
    version: int
    command: str
    build: Callable[[dict[str, Any]], T]
    mistaken: tuple[tuple[str, str], ...] = ()


def read_model[T](path: str | Path, *formats: Format[T]) -> T:
    """The model in a file of one of the formats. Raises `DataNotFoundError`, `ModelFileError` naming the key that is wrong."""
    path = Path(path)
    content = _read_json(path, " or ".join(f"`{form.command}`" for form in formats))
    found = content.get("format") if isinstance(content, dict) else None
    form = next((form for form in formats if form.name == found), None)
    if form is None:
        raise errors.ModelFileError(f"{path}: {_other_format(str(found), formats)}")
    if content.get("version") != form.version:
        raise errors.ModelFileError(f"{path}: version {content.get('version')}, this program reads {form.version}")
    try:
        return form.build(content)
    except KeyError as error:
        raise errors.ModelFileError(f"{path}: key {error} is missing") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise errors.ModelFileError(f"{path}: {error}") from error


def write_model(path: str | Path, content: dict[str, Any]) -> None:
    """Write the content of a model as JSON, atomically. Raises `OSError`."""
    write_atomically(path, json.dumps(content, indent=1).encode())


def check_unit(unit: str) -> str:
    """The unit of a model file, if it is one. Raises ValueError for another."""
    if unit not in UNITS:
        raise ValueError(f"unit '{unit}' unknown; choose one of {', '.join(UNITS)}")
    return unit


def check_level(level: str) -> str:
    """Where the level of the stresses of a model file is from, if it is one of two. Raises ValueError for another."""
    if level not in (MEASURED, NOMINAL):
        raise ValueError(f"level '{level}' unknown; choose {MEASURED} or {NOMINAL}")
    return level


def check_range(content: Any) -> dict[str, tuple[float, float]]:
    """{invariant: (min, max)} of a model file. Raises ValueError."""
    if not isinstance(content, dict) or not all(isinstance(v, list) and len(v) == 2 for v in content.values()):
        raise ValueError("calibrated_range is not a table of [min, max]")
    result = {name: (float(low), float(high)) for name, (low, high) in content.items()}
    if not all(low <= high for low, high in result.values()):
        raise ValueError(f"calibrated_range {content}: min must not exceed max")
    return result


def _read_json(path: Path, commands: str) -> Any:
    if not path.exists():
        raise errors.DataNotFoundError(f"{path}: no such model file; {commands} writes one")
    try:
        return json.loads(path.read_text())
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise errors.ModelFileError(
            f"{path}: not a JSON model file ({error}); give the model.json of `equigap calibrate` or `equigap discover`"
        ) from error


def _other_format(found: str, formats: tuple[Format[Any], ...]) -> str:
    for form in formats:
        if found in dict(form.mistaken):
            return dict(form.mistaken)[found]
    names = " or ".join(f"'{form.name}'" for form in formats)
    commands = " or ".join(f"`{form.command}`" for form in formats)
    return f"'format' is not {names}; give the model.json that {commands} writes"
