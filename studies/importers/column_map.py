"""Column map: the TOML file that tells how the text tables of a DIC software are laid out (docs/import.md).

In: TOML. Out: a checked `ColumnMap`. Unknown keys are refused with the nearest known one.
"""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from calibrate import errors
from studies.importers.map_tables import (
    EdgesTable,
    ForceTable,
    FramesTable,
    MaskTable,
    NoiseTable,
    PointsTable,
    Positive,
    RecordingTable,
    Table,
)
from studies.importers.masking.masks import Mask
from studies.importers.recording.stated_noise import StatedNoise
from studies.importers.recording.synchronise import Selection


def _listed(value: Any) -> Any:
    """[force] is the only one of [[force]]."""
    return [value] if isinstance(value, dict) else value


class ColumnMap(Table):
    """The whole TOML file. force: load cells; one without sides pulls at all that are loaded."""

    name: str
    points: PointsTable
    force: Annotated[tuple[ForceTable, ...], Field(strict=False, min_length=1), BeforeValidator(_listed)]
    edges: EdgesTable
    frames: FramesTable = FramesTable()
    mask: MaskTable = MaskTable()
    noise: NoiseTable = NoiseTable()
    recording: RecordingTable = RecordingTable()
    thickness_mm: Positive | None = None
    plane: Literal["stress", "strain"] = "stress"

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        p, edges = self.points, self.edges
        if ("px" in p.units) != (p.scale_mm_per_px is not None):
            raise ValueError("points.scale_mm_per_px belongs to a unit 'px', and only to it")
        if not edges.loaded:
            raise ValueError("edges.loaded (--loaded) names no side; name those that are gripped")
        if both := sorted(set(edges.loaded) & set(edges.free)):
            raise ValueError(
                f"'{both[0]}' is in edges.loaded and edges.free (--loaded, --free); a loaded side is not free"
            )
        if len(self.force) == 1 and len({side in ("left", "right") for side in edges.loaded}) > 1:
            raise ValueError(
                f"edges.loaded: {', '.join(edges.loaded)} are pulled along x and y, and [force] names one force; name opposite sides, or "
                "give each axis a [[force]] with its sides (docs/import.md)"
            )
        if wrong := [side for side in edges.beyond_mm if side not in edges.free]:
            raise ValueError(
                f"edges.beyond_mm: side '{wrong[0]}' is not in edges.free; only a free edge is continued to"
            )
        if (edges.holes or edges.arcs or edges.lines) and not edges.free:
            raise ValueError(
                "edges.holes, edges.arcs and edges.lines are free of traction: name 'holes', and sides that are free, in edges.free"
            )
        if edges.rim and edges.free:
            raise ValueError("edges.rim: a window in a larger body has no free edge; leave out edges.free")
        if self.noise.correlation_length_mm is not None and self.noise.displacement_std_mm is None:
            raise ValueError("noise.correlation_length_mm belongs to noise.displacement_std_mm; state both or none")
        of_pictures = self.noise.pattern_std_mm, self.noise.reference_std_mm, self.noise.correlation_time_s
        if any(of_pictures) and not self.noise.displacement_std_mm:
            raise ValueError(
                "noise.pattern_std_mm, noise.reference_std_mm and noise.correlation_time_s tell what pictures share; state "
                "noise.displacement_std_mm too, what is new in each or drifts"
            )
        timed = self.frames.rate_hz is not None or self.frames.times_s is not None
        if any(not cell.per_frame and not (timed and cell.time) for cell in self.force):
            raise ValueError(
                "give frames.rate_hz and force.time (or frames.times_s and force.time), or force.per_frame = true"
            )
        if self.frames.times_s is not None and any(cell.per_frame and cell.time for cell in self.force):
            raise ValueError(
                "frames.times_s and force.time both tell the times of the pictures, as force.per_frame has a row for each; leave one out"
            )
        if len(self.force) > 1 and self.frames.tare_N is not None:
            raise ValueError(
                "frames.tare_N is of one load cell; with several [[force]] each counts from its reading at the reference picture: leave it out"
            )
        if len(self.force) > 1 and sorted(s for cell in self.force for s in cell.sides) != sorted(edges.loaded):
            raise ValueError("force.sides: every side of edges.loaded needs one load cell, and only one")
        return self

    @property
    def masks(self) -> Mask:
        """What is left out, of [mask] and [edges]."""
        m, e = self.mask, self.edges
        return Mask(
            m.points,
            m.boxes,
            m.circles,
            {str(k): v for k, v in e.drop_mm.items()},
            {str(k): v for k, v in e.drop_points.items()},
            m.outliers == "mask",
        )

    @property
    def selection(self) -> Selection:
        """Which frames become increments, of [frames]."""
        f = self.frames
        return Selection(f.count, f.list, f.until_s, f.onset, f.tare_N)

    @property
    def stated_noise(self) -> StatedNoise:
        """Noise as far as [noise] states it, mm and N."""
        n = self.noise
        return StatedNoise(
            n.displacement_std_mm, n.correlation_length_mm, n.force_std_N, n.force_std_relative,
            n.pattern_std_mm, n.reference_std_mm, n.correlation_time_s,
        )  # fmt: skip


def read_map(path: str | Path) -> ColumnMap:
    """Read a TOML column map; FILE#NAME: one of its [[test]]. Raises `ConfigError` that names the key, `DataNotFoundError`."""
    file, _, name = str(path).partition("#")
    content = _toml(Path(file))
    tests = {str(test.get("name")): test for test in _tests(file, content.pop("test", []))}
    if tests and name not in tests:
        raise errors.ConfigError(
            f"{file}: holds several tests; name one: " + ", ".join(f"{file}#{one}" for one in tests)
        )
    if name and not tests:
        raise errors.ConfigError(f"{file}: has no [[test]], so no '{name}'; leave out what follows the #")
    return checked_map(_merged(content, tests[name]) if tests else content, path)


def tests_of(path: str | Path) -> tuple[str, ...]:
    """Names of the [[test]] of a TOML file; none where it is one test. Raises what `read_map` does."""
    names = [test.get("name") for test in _tests(str(path), _toml(Path(path)).get("test", []))]
    if None in names or len(set(names)) < len(names):
        raise errors.ConfigError(f"{path}: every [[test]] needs a name of its own")
    return tuple(map(str, names))


def _tests(file: str, tests: Any) -> list[dict[str, Any]]:
    """Those of a TOML file. Raises `ConfigError`."""
    if not isinstance(tests, list) or not all(isinstance(test, dict) for test in tests):
        raise errors.ConfigError(f"{file}: [test] is one table; write [[test]], once for each test")
    return tests


def _merged(common: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    """Tables of a test over those that all share."""
    both = {
        key: _merged(common[key], value)
        for key, value in own.items()
        if isinstance(value, dict) and isinstance(common.get(key), dict)
    }
    return common | own | both


def _toml(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise errors.DataNotFoundError(f"{path}: no such file; see docs/import.md for column maps")
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise errors.ConfigError(f"{path}, line {line}: not UTF-8; save it as UTF-8") from error
    except tomllib.TOMLDecodeError as error:
        raise errors.ConfigError(f"{path}: not valid TOML ({error})") from error


def checked_map(content: dict[str, Any], source: str | Path) -> ColumnMap:
    """The column map of nested tables. Raises `ConfigError` that names source and key."""
    try:
        return ColumnMap.model_validate(content)
    except ValidationError as error:
        raise errors.ConfigError(f"{source}: {_reason(error)}") from None


def _reason(error: ValidationError) -> str:
    """What is wrong with the first key that is, and what to write instead."""
    first = min(error.errors(), key=lambda found: found["type"] != "extra_forbidden")
    place = ".".join(map(str, first["loc"])).replace("force.0.", "force.")
    match first["type"]:
        case "extra_forbidden":
            known = _keys(first["loc"][:-1])
            close = difflib.get_close_matches(str(first["loc"][-1]), known, 1)
            hint = f"did you mean '{close[0]}'?" if close else f"known: {', '.join(known)}"
            return f"unknown key '{place}'; {hint}"
        case "missing":
            return f"key '{place}' is missing"
        case "literal_error":
            return f"{place} = '{first['input']}' unknown; choose one of {first['ctx']['expected']}"
        case "value_error":
            return str(first["ctx"]["error"])
        case _:
            return f"{place} = {first['input']!r}: {first['msg'].replace('tuple', 'list')}"


def _keys(place: tuple[int | str, ...]) -> list[str]:
    """Keys of the table at a place."""
    table: Any = ColumnMap
    for name in place:
        if not isinstance(name, int):
            annotation = table.model_fields[name].annotation
            table = next((one for one in get_args(annotation) if one is not Ellipsis), annotation)
    return list(table.model_fields)
