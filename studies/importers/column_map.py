"""Column map: the TOML file that tells how the text tables of a DIC software are laid out (docs/import.md).

In: TOML. Out: a checked `ColumnMap`. Unknown keys are refused with the nearest known one.
"""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from calibrate import errors
from studies.importers.recording.masks import Mask
from studies.importers.recording.stated_noise import StatedNoise
from studies.importers.recording.synchronise import Selection

LENGTH_UNITS = {"mm": 1.0, "cm": 10.0, "m": 1e3, "um": 1e-3}
FORCE_UNITS = {"N": 1.0, "kN": 1e3, "mN": 1e-3}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "min": 60.0}
type LengthUnit = Literal["px", "mm", "cm", "m", "um"]
type Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
type NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
type PositiveNumber = Annotated[int, Field(gt=0)]
type NotNegativeNumber = Annotated[int, Field(ge=0)]
type Side = Literal["left", "right", "bottom", "top"]


class Table(BaseModel):
    """A table of the TOML file: no other keys, and no value is converted but a whole number to a float."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class PointsTable(Table):
    """[points]: one table a frame. files: glob; the frames are sorted by the last number in their names and the
    first is the reference. x, y, u, v: columns of position and displacement. unit: of both, 'px' with scale_mm_per_px, or
    a length; position_unit, displacement_unit: of one alone. y_axis: 'up' or 'down' (image coordinates). coordinates: 'reference' or 'current' (position after
    displacement). valid_column with valid_minimum and/or valid_maximum: other points have failed."""

    files: str
    x: str
    y: str
    u: str
    v: str
    unit: LengthUnit = "mm"
    position_unit: LengthUnit | None = None
    displacement_unit: LengthUnit | None = None
    scale_mm_per_px: Positive | None = None
    y_axis: Literal["up", "down"] = "up"
    coordinates: Literal["reference", "current"] = "reference"
    delimiter: str = ","
    header_line: NotNegativeNumber = 1
    units_row: bool = False
    comment: str = ""
    valid_column: str | None = None
    valid_minimum: float | None = None
    valid_maximum: float | None = None
    max_edge_mm: Positive | None = None

    @property
    def units(self) -> tuple[LengthUnit, LengthUnit]:
        """Of position and displacement."""
        return self.position_unit or self.unit, self.displacement_unit or self.unit

    @property
    def scales(self) -> tuple[float, float]:
        """mm per unit of position and of displacement."""
        position, displacement = (LENGTH_UNITS.get(unit, self.scale_mm_per_px or 1.0) for unit in self.units)
        return position, displacement


class FramesTable(Table):
    """[frames]: rate_hz and offset_s (time of the reference frame on the clock of the machine), or one force a
    frame ([force] per_frame). count, list, until_s, onset, tare_N: which frames are kept (see `Selection`)."""

    rate_hz: Positive | None = None
    offset_s: float = 0.0
    count: PositiveNumber = 12
    list: tuple[int, ...] | None = Field(default=None, strict=False)
    until_s: float | None = None
    onset: Annotated[float, Field(ge=0, lt=1)] = 0.01
    tare_N: float | None = None


class ForceTable(Table):
    """[force]: file and columns of the machine record; sign = -1 where tension is recorded as negative.
    per_frame: one row a frame, in their order; then no time is needed."""

    file: str
    force: str
    time: str | None = None
    unit: Literal["N", "kN", "mN"] = "N"
    time_unit: Literal["s", "ms", "min"] = "s"
    sign: float = 1.0
    per_frame: bool = False
    delimiter: str = ","
    header_line: NotNegativeNumber = 1
    units_row: bool = False
    comment: str = ""


class EdgesTable(Table):
    """[edges]: loaded: sides ('left', 'right', 'bottom', 'top') that are gripped, each with the force of the record
    pulling outwards; free: sides and 'holes' that are truly traction-free. tolerance_mm: nodes this close to the
    extreme coordinate belong to the side (default: 0.4 of the spacing of the points). drop_mm, drop_points: by side, how far
    inwards, or how many rows of points, are left out before the sides are found. rim: the window lies in a larger body, so that
    its section does not carry the force of the record: only ratios of stiffness are identified."""

    loaded: tuple[Side, ...] = Field(strict=False)
    free: tuple[Side | Literal["holes"], ...] = Field(default=(), strict=False)
    tolerance_mm: Positive | None = None
    drop_mm: dict[Side, NotNegative] = {}
    drop_points: dict[Side, NotNegativeNumber] = {}
    rim: bool = False


class MaskTable(Table):
    """[mask]: points that are left out, mm of the imported frame (y up). points: [[x, y], ...]; boxes: [[x0, y0, x1, y1], ...];
    circles: [[x, y, radius], ...]; column: of the reference table, not 0 where a point goes. outliers: 'mask' or 'keep' what the
    test for spurious points finds."""

    points: tuple[Annotated[tuple[float, float], Field(strict=False)], ...] = Field(default=(), strict=False)
    boxes: tuple[Annotated[tuple[float, float, float, float], Field(strict=False)], ...] = Field(
        default=(), strict=False
    )
    circles: tuple[Annotated[tuple[float, float, float], Field(strict=False)], ...] = Field(default=(), strict=False)
    column: str | None = None
    outliers: Literal["mask", "keep"] = "mask"


class NoiseTable(Table):
    """[noise]: what is known of the noise; the rest is estimated. kind: 'total' or 'temporal' of the estimate."""

    displacement_std_mm: NotNegative | None = None
    correlation_length_mm: NotNegative | None = None
    force_std_relative: NotNegative | None = None
    force_std_N: NotNegative | None = None
    kind: Literal["total", "temporal"] = "total"


class ColumnMap(Table):
    """The whole TOML file."""

    name: str
    points: PointsTable
    force: ForceTable
    edges: EdgesTable
    frames: FramesTable = FramesTable()
    mask: MaskTable = MaskTable()
    noise: NoiseTable = NoiseTable()
    thickness_mm: Positive | None = None
    plane: Literal["stress", "strain"] = "stress"

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        p, edges = self.points, self.edges
        if ("px" in p.units) != (p.scale_mm_per_px is not None):
            raise ValueError("points.scale_mm_per_px belongs to a unit 'px', and only to it")
        if not edges.loaded or set(edges.loaded) & set(edges.free):
            raise ValueError("edges.loaded must name a side, and a loaded side is not free")
        if len({side in ("left", "right") for side in edges.loaded}) > 1:
            raise ValueError(
                f"edges.loaded: {', '.join(edges.loaded)} are pulled along x and y, and [force] names one force; name opposite sides, or "
                "make an Experiment with both forces in Python (docs/extending.md, an importer)"
            )
        if edges.rim and edges.free:
            raise ValueError("edges.rim: a window in a larger body has no free edge; leave out edges.free")
        if self.noise.correlation_length_mm is not None and self.noise.displacement_std_mm is None:
            raise ValueError("noise.correlation_length_mm belongs to noise.displacement_std_mm; state both or none")
        if not self.force.per_frame and (self.frames.rate_hz is None or self.force.time is None):
            raise ValueError("give frames.rate_hz and force.time, or force.per_frame = true")
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
        return StatedNoise(n.displacement_std_mm, n.correlation_length_mm, n.force_std_N, n.force_std_relative)


def read_map(path: str | Path) -> ColumnMap:
    """Read a TOML column map. Raises `ConfigError` that names the key, `DataNotFoundError`."""
    path = Path(path)
    if not path.is_file():
        raise errors.DataNotFoundError(f"{path}: no such file; see docs/import.md for column maps")
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise errors.ConfigError(f"{path}: not valid TOML ({error})") from error
    try:
        return ColumnMap.model_validate(content)
    except ValidationError as error:
        raise errors.ConfigError(f"{path}: {_reason(error)}") from None


def _reason(error: ValidationError) -> str:
    """What is wrong with the first key that is, and what to write instead."""
    first = min(error.errors(), key=lambda found: found["type"] != "extra_forbidden")
    place = ".".join(map(str, first["loc"]))
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
        table = table.model_fields[name].annotation
    return list(table.model_fields)
