"""A history file: when a sheet is loaded and unloaded and what its law has beside the material, as TOML in, a checked `History` out.

Stresses in MPa, times in s, lengths in mm, angles in rad (docs/forward.md#sheets-with-a-history).
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, fields
from dataclasses import Field as DataField
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from forward.errors import MaterialError
from forward.materials import Material
from forward.sheet import additions as laws
from forward.sheet.damage_and_dispersion import DispersedFibres, OgdenRoxburgh
from forward.sheet.multiplicative_viscosity import MaxwellBranch
from forward.sheet.thin_sheet import PermanentSet, Prony, Sheet
from studies.commandline.option_types import nearest
from studies.errors import OptionError

ADDITIONS: dict[str, type[laws.Addition]] = {
    kind.name: kind
    for kind in (
        laws.MooneyPart,
        laws.CubicPart,
        laws.Fibres,
        DispersedFibres,
        laws.Gradient,
        laws.Patch,
        laws.CosineField,
        laws.Mullins,
        laws.Payne,
        OgdenRoxburgh,
    )
}


class History(BaseModel):
    """factors: of the displacement, at `times`, straight lines between, one picture at each. substeps: steps between pictures, at which the load cell
    is read, too. addition:
    tables with a `law` of `ADDITIONS` and its values. branch, viscosity, permanent_set, bulk_modulus: as of a `Sheet`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    times: tuple[float, ...] = Field(min_length=1)
    factors: tuple[float, ...] = Field(min_length=1)
    substeps: int = Field(default=1, ge=1)
    addition: tuple[dict[str, Any], ...] = ()
    branch: tuple[dict[str, Any], ...] = ()
    viscosity: dict[str, Any] | None = None
    permanent_set: dict[str, Any] | None = None
    bulk_modulus: float | None = None

    @model_validator(mode="after")
    def _one_factor_a_time(self) -> Self:
        if len(self.times) != len(self.factors):
            raise ValueError(f"{len(self.times)} times, but {len(self.factors)} factors; give one factor at each time")
        return self

    @property
    def readings(self) -> list[tuple[float, float]]:
        """Times, s, and factors of the steps between the pictures."""
        knots, values = np.array([0.0, *self.times]), np.array([0.0, *self.factors])
        places = np.arange(1, self.substeps) / self.substeps + np.arange(len(self.times))[:, None]
        at = np.arange(len(knots))
        return [(float(np.interp(p, at, knots)), float(np.interp(p, at, values))) for p in places.ravel()]

    def sheet(self, material: Material, thickness: float) -> Sheet:
        """The sheet of a material, thickness in mm. Raises `OptionError`, `MaterialError`."""
        return Sheet(
            material,
            thickness,
            tuple(_addition(table) for table in self.addition),
            () if self.viscosity is None else (_made("[viscosity]", Prony, self.viscosity),),
            None if self.permanent_set is None else _made("[permanent_set]", PermanentSet, self.permanent_set),
            self.bulk_modulus,
            tuple(_made("[[branch]]", MaxwellBranch, table) for table in self.branch),
        )


def read_history(path: str) -> History:
    """Read a history file. Raises `OptionError` that names the file, the key and what is wrong with it."""
    try:
        return History.model_validate(tomllib.loads(Path(path).read_text(encoding="utf-8")))
    except OSError as error:
        raise OptionError(f"{path}: {error.strerror}; name a history file (docs/forward.md has one)") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise OptionError(f"{path}: no valid TOML ({error})") from error
    except ValidationError as error:
        raise OptionError(f"{path}: {'; '.join(_complaint(item) for item in error.errors())}") from error


def sheet_of(path: str, history: History, material: Material, thickness: float) -> Sheet:
    """The sheet of a history file. Raises `OptionError` that names the file."""
    try:
        return history.sheet(material, thickness)
    except (OptionError, MaterialError) as error:
        raise OptionError(f"{path}: {error}") from error


def _addition(table: Mapping[str, Any]) -> laws.Addition:
    values = dict(table)
    name = values.pop("law", None)
    if name not in ADDITIONS:
        raise OptionError(
            f"[[addition]] law '{name}' is unknown{nearest(str(name), ADDITIONS)}; choose from {', '.join(ADDITIONS)}"
        )
    if name == laws.Mullins.name and ("m" in values) != ("beta" in values):
        raise OptionError(
            "[[addition]] Mullins: give m and beta together, or neither (beta = 0.001 is that of Ogden and Roxburgh, without one)"
        )
    return _made(f"[[addition]] {name}", ADDITIONS[name], values)


def _made(place: str, kind: type, values: Mapping[str, Any]) -> Any:
    """One part of a sheet by its values; lists become tuples. Raises `OptionError` for a name or a value that does not fit."""
    known = {entry.name: entry for entry in fields(kind)}
    for key in values:
        if key not in known:
            raise OptionError(f"{place}: unknown key '{key}'{nearest(key, known)}; it has {', '.join(known)}")
    missing = [key for key, entry in known.items() if entry.default is MISSING and key not in values]
    if missing:
        raise OptionError(f"{place}: {', '.join(missing)} must be given")
    return kind(**{key: _value(f"{place}: {key}", known[key], value) for key, value in values.items()})


def _value(place: str, entry: DataField[Any], value: Any) -> float | tuple[float, ...]:
    """A number, or a tuple of them where the field is one. Raises `OptionError`."""
    several = str(entry.type).startswith("tuple")
    numbers = value if several and isinstance(value, list) else [value]
    if several != isinstance(value, list) or not all(
        isinstance(x, int | float) and not isinstance(x, bool) for x in numbers
    ):
        raise OptionError(f"{place} = {value!r}; give {'a list of numbers' if several else 'a number'}")
    return tuple(float(x) for x in numbers) if several else float(numbers[0])


def _complaint(item: Mapping[str, Any]) -> str:
    """One of pydantic's errors in a line: where, what, and the nearest key."""
    place = ".".join(str(part) for part in item["loc"])
    if item["type"] == "extra_forbidden":
        return f"unknown key '{place}'{nearest(place, History.model_fields)}"
    return f"{place or 'times'}: {item['msg'].removeprefix('Value error, ')}"
