"""Column map: the TOML file that tells how the text tables of a DIC software are laid out (docs/import.md).

In: TOML. Out: a checked `ColumnMap`. Unknown keys are refused with the nearest known one.
"""

from __future__ import annotations

import difflib
import tomllib
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, get_args, get_type_hints

from calibrate import errors
from calibrate.data.experiment import PLANES, Noise
from studies.importers.synchronise import Selection

LENGTH_UNITS = {"mm": 1.0, "cm": 10.0, "m": 1e3, "um": 1e-3}
FORCE_UNITS = {"N": 1.0, "kN": 1e3, "mN": 1e-3}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "min": 60.0}
SIDES = {"left": (0, -1), "right": (0, 1), "bottom": (1, -1), "top": (1, 1)}


@dataclass(frozen=True)
class PointsTable:
    """[points]: one table a frame. files: glob; the frames are sorted by the last number in their names and the
    first is the reference. x, y, u, v: columns of position and displacement. unit: 'px' with scale_mm_per_px, or
    a length. y_axis: 'up' or 'down' (image coordinates). coordinates: 'reference' or 'current' (position after
    displacement). valid_column with valid_minimum and/or valid_maximum: other points have failed."""

    files: str
    x: str
    y: str
    u: str
    v: str
    unit: str = "mm"
    scale_mm_per_px: float | None = None
    y_axis: str = "up"
    coordinates: str = "reference"
    delimiter: str = ","
    header_line: int = 1
    units_row: bool = False
    comment: str = ""
    valid_column: str | None = None
    valid_minimum: float | None = None
    valid_maximum: float | None = None
    max_edge_mm: float | None = None


@dataclass(frozen=True)
class FramesTable:
    """[frames]: rate_hz and offset_s (time of the reference frame on the clock of the machine), or one force a
    frame ([force] per_frame). count, list, until_s, onset, tare_N: which frames are kept (see `Selection`)."""

    rate_hz: float | None = None
    offset_s: float = 0.0
    count: int = 12
    list: tuple[int, ...] | None = None
    until_s: float | None = None
    onset: float = 0.01
    tare_N: float | None = None


@dataclass(frozen=True)
class ForceTable:
    """[force]: file and columns of the machine record; sign = -1 where tension is recorded as negative.
    per_frame: one row a frame, in their order; then no time is needed."""

    file: str
    force: str
    time: str | None = None
    unit: str = "N"
    time_unit: str = "s"
    sign: float = 1.0
    per_frame: bool = False
    delimiter: str = ","
    header_line: int = 1
    units_row: bool = False
    comment: str = ""


@dataclass(frozen=True)
class EdgesTable:
    """[edges]: loaded: sides ('left', 'right', 'bottom', 'top') that are gripped, each with the force of the record
    pulling outwards; free: sides and 'holes' that are truly traction-free. tolerance_mm: nodes this close to the
    extreme coordinate belong to the side (default: 0.4 of the spacing of the points)."""

    loaded: tuple[str, ...]
    free: tuple[str, ...] = ()
    tolerance_mm: float | None = None


@dataclass(frozen=True)
class NoiseTable:
    """[noise]: stated noise; without this table it is estimated. kind: 'total' or 'temporal' of the estimate."""

    displacement_std_mm: float | None = None
    correlation_length_mm: float = 0.0
    force_std_relative: float = 0.0
    force_std_N: float = 0.0
    kind: str = "total"


@dataclass(frozen=True)
class ColumnMap:
    """The whole TOML file."""

    name: str
    points: PointsTable
    force: ForceTable
    edges: EdgesTable
    frames: FramesTable = field(default_factory=FramesTable)
    noise: NoiseTable = field(default_factory=NoiseTable)
    thickness_mm: float | None = None
    plane: str = "stress"

    @property
    def selection(self) -> Selection:
        """Which frames become increments, of [frames]."""
        f = self.frames
        return Selection(f.count, f.list, f.until_s, f.onset, f.tare_N)

    @property
    def stated_noise(self) -> Noise | None:
        """Noise of [noise], mm and N; None where it is to be estimated."""
        n = self.noise
        if n.displacement_std_mm is None:
            return None
        return Noise(n.displacement_std_mm, n.correlation_length_mm, n.force_std_relative, n.force_std_N)


def read_map(path: str | Path) -> ColumnMap:
    """Read a TOML column map. Raises `ConfigError` that names the key, `DataNotFoundError`."""
    path = Path(path)
    if not path.is_file():
        raise errors.DataNotFoundError(f"{path}: no such file; see docs/import.md for column maps")
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise errors.ConfigError(f"{path}: not valid TOML ({error})") from error
    found = parse_table(ColumnMap, content, str(path))
    _check_map(found, str(path))
    return found


def parse_table[Table](kind: type[Table], content: dict[str, Any], where: str) -> Table:
    """A dataclass from a TOML table: unknown, missing and wrongly typed keys raise `ConfigError`."""
    hints = get_type_hints(kind)
    for key in content:
        if key not in hints:
            close = difflib.get_close_matches(key, hints, 1)
            hint = f"did you mean '{close[0]}'?" if close else f"known: {', '.join(hints)}"
            raise errors.ConfigError(f"{where}: unknown key '{key}'; {hint}")
    required = [f.name for f in fields(kind) if _required(f) and f.name not in content]  # type: ignore[arg-type]
    if required:
        raise errors.ConfigError(f"{where}: key '{required[0]}' is missing")
    return kind(**{key: _value(hints[key], value, f"{where}: {key}") for key, value in content.items()})


def _required(f: Any) -> bool:
    return f.default is MISSING and f.default_factory is MISSING


def _value(hint: Any, value: Any, where: str) -> Any:
    options = get_args(hint) if isinstance(hint, UnionType) else (hint,)
    option = next(o for o in options if o is not NoneType)
    if hasattr(option, "__dataclass_fields__"):
        if not isinstance(value, dict):
            raise errors.ConfigError(f"{where} must be a table")
        return parse_table(option, value, where)
    if get_args(option):  # tuple[x, ...]
        if not isinstance(value, list):
            raise errors.ConfigError(f"{where} must be a list, not {value!r}")
        return tuple(_value(get_args(option)[0], v, where) for v in value)
    if option is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not option:
        raise errors.ConfigError(f"{where} must be of type {option.__name__}, not {value!r}")
    return value


def _check_map(m: ColumnMap, where: str) -> None:
    p = m.points
    choices = [
        ("plane", m.plane, list(PLANES)),
        ("points.unit", p.unit, ["px", *LENGTH_UNITS]),
        ("points.y_axis", p.y_axis, ["up", "down"]),
        ("points.coordinates", p.coordinates, ["reference", "current"]),
        ("force.unit", m.force.unit, list(FORCE_UNITS)),
        ("force.time_unit", m.force.time_unit, list(TIME_UNITS)),
        *(("edges.loaded", side, list(SIDES)) for side in m.edges.loaded),
        *(("edges.free", side, [*SIDES, "holes"]) for side in m.edges.free),
    ]
    for key, value, known in choices:
        if value not in known:
            raise errors.ConfigError(f"{where}: {key} = '{value}' unknown; choose one of {', '.join(known)}")
    if (p.unit == "px") != (p.scale_mm_per_px is not None):
        raise errors.ConfigError(f"{where}: points.scale_mm_per_px belongs to unit 'px', and only to it")
    if not m.edges.loaded or set(m.edges.loaded) & set(m.edges.free):
        raise errors.ConfigError(f"{where}: edges.loaded must name a side, and a loaded side is not free")
    if not m.force.per_frame and (m.frames.rate_hz is None or m.force.time is None):
        raise errors.ConfigError(f"{where}: give frames.rate_hz and force.time, or force.per_frame = true")
