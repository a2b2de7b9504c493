"""Tables of a column map: [points], [frames], [force], [edges], [mask], [noise], [recording]. The map as a whole: `column_map`."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from meshes.shapes import Arc, Ellipse
from studies.importers.exports.frame_order import Rule
from studies.importers.text_tables import Layout

LENGTH_UNITS = {"mm": 1.0, "cm": 10.0, "m": 1e3, "um": 1e-3, "in": 25.4}
FORCE_UNITS = {"N": 1.0, "kN": 1e3, "mN": 1e-3, "kgf": 9.80665, "gf": 9.80665e-3, "lbf": 4.4482216152605}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "min": 60.0}
type LengthUnit = Literal["px", "mm", "cm", "m", "um", "in"]
type ForceUnit = Literal["N", "kN", "mN", "kgf", "gf", "lbf"]
type TimeUnit = Literal["s", "ms", "min"]
type Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
type NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
type PositiveNumber = Annotated[int, Field(gt=0)]
type NotNegativeNumber = Annotated[int, Field(ge=0)]
type Decimal = Literal[".", ","]
type Side = Literal["left", "right", "bottom", "top"]


class Table(BaseModel):
    """A table of the TOML file: no other keys, and no value is converted but a whole number to a float."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class PointsTable(Table):
    """[points]: one table a frame. files: glob, or the files in their order; folder: where they are, relative to the map. order: of a
    glob, by the number in the names, 'natural' where several disagree. reference: 'first' file, or 'separate' where displacements count
    from a picture without a file. layout: 'table', or 'matrix' without header, one quantity a file: u, v (and x, y) are then what the
    names end with, files those of u, step the distance of the points. x, y, u, v: columns of position and displacement; z, w: out of
    plane. unit: of both, 'px' with scale_mm_per_px, or
    a length; position_unit, displacement_unit: of one alone. y_axis: 'up' or 'down' (image coordinates). coordinates: 'reference' or 'current' (position after
    displacement). valid_column with valid_minimum and/or valid_maximum: other points have failed."""

    files: str | Annotated[tuple[str, ...], Field(strict=False)]
    folder: str = "."
    order: Rule = "auto"
    reference: Literal["first", "separate"] = "first"
    layout: Literal["table", "matrix", "ncorr"] = "table"
    x: str = ""
    y: str = ""
    u: str
    v: str
    z: str | None = None
    w: str | None = None
    step: Positive | None = None
    unit: LengthUnit = "mm"
    position_unit: LengthUnit | None = None
    displacement_unit: LengthUnit | None = None
    scale_mm_per_px: Positive | None = None
    y_axis: Literal["up", "down"] = "up"
    coordinates: Literal["reference", "current"] = "reference"
    delimiter: Annotated[str, Field(min_length=1)] = ","
    decimal: Decimal = "."
    missing_words: tuple[str, ...] = Field(default=(), strict=False)
    header_line: NotNegativeNumber = 1
    units_row: bool = False
    comment: str = ""
    valid_column: str | None = None
    valid_minimum: float | None = None
    valid_maximum: float | None = None
    max_edge_mm: Positive | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.layout == "table" and not (self.x and self.y):
            raise ValueError("key 'points.x' is missing" if not self.x else "key 'points.y' is missing")
        if self.layout == "matrix" and self.step is None and not (self.x and self.y):
            raise ValueError("points.step: give the distance of the points of a matrix, or x and y")
        if (self.z is None) != (self.w is None):
            raise ValueError("points.z and points.w: give both or none")
        return self

    @property
    def text(self) -> Layout:
        """How its tables are written."""
        words = tuple(word.lower() for word in self.missing_words)
        return Layout(self.delimiter, self.header_line, self.units_row, self.comment, True, self.decimal, words)

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
    """[frames]: rate_hz and offset_s (time of the reference frame on the clock of the machine), or one force a frame ([force] per_frame), or times_s,
    of every frame, to which offset_s is added. count, list, until_s, onset, tare_N: which frames are kept (see `Selection`)."""

    rate_hz: Positive | None = None
    times_s: tuple[float, ...] | None = Field(default=None, strict=False)
    offset_s: float = 0.0
    count: PositiveNumber | None = None
    list: tuple[int, ...] | None = Field(default=None, strict=False)
    until_s: float | None = None
    onset: Annotated[float, Field(ge=0, lt=1)] = 0.01
    tare_N: float | None = None

    @model_validator(mode="after")
    def _increasing(self) -> Self:
        for k, (before, after) in enumerate(pairwise(self.times_s or ()), 1):
            if after < before or (after == before and k > 1):  # the reference may be taken as the loading begins
                where = f"frames.times_s: picture {k} (from 0) at {after:g} s is not later than that before"
                raise ValueError(f"{where}, at {before:g} s; correct it, or leave out one, and its file")
        return self


class ForceTable(Table):
    """[force]: file and columns of the machine record; sign = -1 where tension is recorded as negative.
    per_frame: one row a frame, in their order; then no time is needed. picture: with per_frame, the column that names the picture of a row, by
    which rows are found. in_frames: no file, every frame's own file holds its value. sides: those it pulls at; needed where there are several load
    cells, each with a [[force]] of its own. crosshead: column of its position, in any unit."""

    file: str = ""
    in_frames: bool = False
    force: str
    time: str | None = None
    crosshead: str | None = None
    unit: ForceUnit = "N"
    time_unit: TimeUnit = "s"
    sign: float = 1.0
    per_frame: bool = False
    picture: str | None = None
    sides: tuple[Side, ...] = Field(default=(), strict=False)
    delimiter: Annotated[str, Field(min_length=1)] = ","
    decimal: Decimal = "."
    header_line: NotNegativeNumber = 1
    units_row: bool = False
    comment: str = ""

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if not self.file and not self.in_frames:
            raise ValueError("key 'force.file' is missing")
        if self.in_frames and (self.file or not self.per_frame):
            raise ValueError(
                "force.in_frames: the value is in the frames themselves; leave out force.file, and set per_frame"
            )
        if self.picture and (self.in_frames or not self.per_frame):
            raise ValueError(
                "force.picture: rows are found by their pictures where force.per_frame is set, in a force.file"
            )
        return self

    @property
    def text(self) -> Layout:
        """How the table is written."""
        return Layout(self.delimiter, self.header_line, self.units_row, self.comment, True, self.decimal)


class HoleTable(Table):
    """[[edges.holes]]: a circle or ellipse, mm of the imported frame (y up), free of traction. centre: [x, y]; diameter, or diameters of both axes, the first of which has
    angle_deg to x."""

    centre: Annotated[tuple[float, float], Field(strict=False)]
    diameter: Positive | None = None
    diameters: Annotated[tuple[Positive, Positive], Field(strict=False)] | None = None
    angle_deg: float = 0.0

    @model_validator(mode="after")
    def _one_size(self) -> Self:
        if (self.diameter is None) == (self.diameters is None):
            raise ValueError("edges.holes: give diameter, or diameters of both axes")
        return self

    @property
    def ellipse(self) -> Ellipse:
        """Its rim."""
        one, other = self.diameters or (self.diameter or 0.0,) * 2
        turned = np.radians(self.angle_deg) + (np.pi / 2 if other > one else 0.0)
        return Ellipse(*self.centre, max(one, other) / 2, min(one, other) / 2, float(turned))


class ArcTable(Table):
    """[[edges.arcs]]: a fillet or a notch at the outline, mm of the imported frame (y up), free of traction: the part of a circle from from_deg to to_deg, anticlockwise from x.
    The specimen is outside of the circle."""

    centre: Annotated[tuple[float, float], Field(strict=False)]
    radius: Positive
    from_deg: float
    to_deg: float

    @model_validator(mode="after")
    def _runs_forward(self) -> Self:
        if not 0 < self.to_deg - self.from_deg < 360:
            raise ValueError(
                "edges.arcs: to_deg must be larger than from_deg, by less than 360 (from 350 to 370, not to 10)"
            )
        return self

    @property
    def ellipse(self) -> Arc:
        """Its rim."""
        ends = np.radians([self.from_deg, self.to_deg])
        return Arc(*self.centre, self.radius, self.radius, 0.0, float(ends[0]), float(ends[1]))


class LineTable(Table):
    """[[edges.lines]]: a straight edge from start to end, mm of the imported frame (y up), free of traction."""

    start: Annotated[tuple[float, float], Field(strict=False)]
    end: Annotated[tuple[float, float], Field(strict=False)]

    @model_validator(mode="after")
    def _has_length(self) -> Self:
        if self.start == self.end:
            raise ValueError("edges.lines: start and end are the same")
        return self


class EdgesTable(Table):
    """[edges]: loaded: sides ('left', 'right', 'bottom', 'top') that are gripped, each with the force of the record
    pulling outwards; free: sides and 'holes' that are truly traction-free. tolerance_mm: nodes this close to the
    extreme coordinate belong to the side (default: 0.4 of the spacing of the points). drop_mm, drop_points: by side, how far
    inwards, or how many rows of points, are left out before the sides are found. rim: the window lies in a larger body, so that
    its section does not carry the force of the record: only ratios of stiffness are identified. holes, arcs, lines: round ones, and round and straight parts of the outline, whose rims the points do not reach; beyond_mm: by free side, how far the true edge is beyond the outermost points; fit_holes: whether
    other openings that are free and a staircase of points get the largest circle or ellipse between their points."""

    loaded: tuple[Side, ...] = Field(strict=False)
    free: tuple[Side | Literal["holes"], ...] = Field(default=(), strict=False)
    tolerance_mm: Positive | None = None
    drop_mm: dict[Side, NotNegative] = {}
    drop_points: dict[Side, NotNegativeNumber] = {}
    rim: bool = False
    holes: tuple[HoleTable, ...] = Field(default=(), strict=False)
    arcs: tuple[ArcTable, ...] = Field(default=(), strict=False)
    lines: tuple[LineTable, ...] = Field(default=(), strict=False)
    fit_holes: bool = True

    beyond_mm: dict[Side, Positive] = {}

    @property
    def rims(self) -> tuple[Ellipse, ...]:
        """Of holes and arcs."""
        return (*(hole.ellipse for hole in self.holes), *(arc.ellipse for arc in self.arcs))


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
    pattern_std_mm: NotNegative | None = None
    reference_std_mm: NotNegative | None = None
    correlation_time_s: NotNegative | None = None
    kind: Literal["total", "temporal"] = "total"


class RecordingTable(Table):
    """[recording]: how the pictures were taken and matched, in words, after the table of Jones and Iadicola (A Good Practices Guide
    for Digital Image Correlation, iDICs 2018); what is not stated is 'not stated' in the report."""

    camera: str | None = None
    lens: str | None = None
    image_resolution: str | None = None
    field_of_view: str | None = None
    image_scale: str | None = None
    frame_rate: str | None = None
    patterning: str | None = None
    stereo_angle: str | None = None
    software: str | None = None
    subset: str | None = None
    step: str | None = None
    matching_criterion: str | None = None
    interpolation: str | None = None
    shape_functions: str | None = None
    filter: str | None = None
    strain_window: str | None = None
    static_frames: PositiveNumber | None = None
