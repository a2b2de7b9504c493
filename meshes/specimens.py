"""Specimens: dimensions in mm in, outline, holes, named boundaries and exact area out.

Every specimen is a polygon with rounded corners, centred at the origin and symmetric to both axes, with
elliptic holes. Where it meets its bounding box, the sides are called left, right, bottom and top; `loaded`
names those that grips hold. All other edges are free.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from meshes.errors import SpecimenError
from meshes.shapes import Corner, Ellipse, distance, fillet_points, rotations, signed_distance, triples, turn_angle

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Specimen:
    """Base of all specimens. Raises `SpecimenError` for dimensions that do not fit together.

    loaded: sides that grips hold. displacement: of each rigid grip where none is given, mm; None where rigid grips cannot hold it.
    """

    name: ClassVar[str]
    loaded: ClassVar[tuple[str, ...]]
    displacement: ClassVar[float | None]

    @property
    def sizes(self) -> tuple[float, float]:
        """Mesh size at the holes and far from them, mm."""
        raise NotImplementedError

    def __post_init__(self) -> None:
        for key, value in self.dimensions().items():
            if not (isinstance(value, (int, float)) and math.isfinite(value) and value > 0):
                raise SpecimenError(f"{self.name}: {key} = {value}; give a positive length in mm")
        if self.sizes[0] > self.sizes[1]:
            raise SpecimenError(f"{self.name}: hole_size exceeds far_size; the mesh is graded towards the holes")
        self._check_shape()
        self._check_corners()
        self._check_holes()

    def dimensions(self) -> dict[str, float]:
        """Every parameter by name, mm."""
        return asdict(self)

    def corners(self) -> list[Corner]:
        """Corners of the outline, anticlockwise."""
        raise NotImplementedError

    def holes(self) -> list[Ellipse]:
        """Holes of the whole specimen; none by default."""
        return []

    @property
    def half_extent(self) -> tuple[float, float]:
        """Half width and half height of the bounding box, mm."""
        return max(c.x for c in self.corners()), max(c.y for c in self.corners())

    @property
    def boundaries(self) -> tuple[str, ...]:
        """Names of the boundaries of the full mesh."""
        return ("left", "right", "bottom", "top", "free", *(f"hole_{i}" for i in range(len(self.holes()))))

    def exact_area(self) -> float:
        """Area in closed form, mm^2: polygon, minus what the fillets round off or fill, minus the holes."""
        area = -sum(hole.area for hole in self.holes())
        for before, corner, after in triples(self.corners()):
            area += (corner.x * after.y - after.x * corner.y) / 2
            turn = turn_angle(before, corner, after)
            area -= corner.radius**2 * (math.tan(turn / 2) - turn / 2)
        return area

    def to_dict(self) -> dict[str, Any]:
        """Name and dimensions, for a manifest; `specimen_from_dict` reads it."""
        return {"specimen": self.name, **self.dimensions()}

    def outline(self) -> Array:
        """Outline with its fillets as a polygon (n, 2), for checks and sizes, mm."""
        points = []
        for before, corner, after in triples(self.corners()):
            points.append(fillet_points(before, corner, after) if corner.radius else [[corner.x, corner.y]])
        return np.concatenate(points)

    def _check_shape(self) -> None:
        """Conditions of one kind of specimen."""

    def _check_corners(self) -> None:
        for before, corner, after in triples(self.corners()):
            tangent = corner.radius * abs(math.tan(turn_angle(before, corner, after) / 2))
            if tangent > min(distance(before, corner), distance(corner, after)):
                raise SpecimenError(f"{self.name}: a fillet of radius {corner.radius:g} does not fit; make it smaller")

    def _check_holes(self) -> None:
        outline, holes = self.outline(), self.holes()
        for hole in holes:
            gap = signed_distance(hole.rim(), outline).min()
            if gap <= 0.5:
                raise SpecimenError(
                    f"{self.name}: the hole at ({hole.x:g}, {hole.y:g}) is {gap:.2f} mm from the outline; "
                    "at least 0.5 mm are needed. Move it or make it smaller"
                )
        for one, other in combinations(holes, 2):
            if other.level(one.rim()).min() <= 1 or one.level(other.rim()).min() <= 1:
                raise SpecimenError(
                    f"{self.name}: holes at ({one.x:g}, {one.y:g}) and ({other.x:g}, {other.y:g}) overlap"
                )


@dataclass(frozen=True)
class Cross(Specimen):
    """Two crossing strips with rounded inner corners and nine elliptic holes, pulled at its four arms.

    Holes: centre, long axis along x; (+-inner_offset, +-inner_offset), long axis radial; (+-outer_offset, 0)
    and (0, +-outer_offset), long axis along y. The semi-minor axis and the length of 200 mm are published;
    the rest is this project's choice, because the drawing is not available.
    """

    half_length: float = 100.0
    half_width: float = 40.0
    fillet_radius: float = 20.0
    hole_semi_major: float = 7.5
    hole_semi_minor: float = 3.75
    inner_offset: float = 22.0
    outer_offset: float = 48.0
    hole_size: float = 1.2
    far_size: float = 6.0

    name: ClassVar[str] = "cross"
    loaded: ClassVar[tuple[str, ...]] = ("left", "right", "bottom", "top")
    displacement: ClassVar[float | None] = 60.0

    @property
    def sizes(self) -> tuple[float, float]:
        return self.hole_size, self.far_size

    def _check_shape(self) -> None:
        if self.half_width >= self.half_length:
            raise SpecimenError("cross: half_width must be smaller than half_length, or no arms are left")
        if self.hole_semi_minor > self.hole_semi_major:
            raise SpecimenError("cross: hole_semi_minor exceeds hole_semi_major; swap them")

    def corners(self) -> list[Corner]:
        L, W, R = self.half_length, self.half_width, self.fillet_radius
        quadrant = [Corner(L, W), Corner(W, W, R), Corner(W, L)]
        return rotations(quadrant)

    def holes(self) -> list[Ellipse]:
        a, b, i, o = self.hole_semi_major, self.hole_semi_minor, self.inner_offset, self.outer_offset
        diagonal = [Ellipse(sx * i, sy * i, a, b, sx * sy * math.pi / 4) for sx in (-1, 1) for sy in (-1, 1)]
        axial = [Ellipse(x, y, a, b, math.pi / 2) for x, y in ((-o, 0), (o, 0), (0, -o), (0, o))]
        return [Ellipse(0, 0, a, b), *diagonal, *axial]


@dataclass(frozen=True)
class Rectangle(Specimen):
    """Base of the rectangular specimens: `half_length` along x, `half_width` along y, mesh size, mm."""

    half_length: float
    half_width: float
    far_size: float

    @property
    def sizes(self) -> tuple[float, float]:
        return self.far_size, self.far_size

    def corners(self) -> list[Corner]:
        L, W = self.half_length, self.half_width
        return [Corner(L, -W), Corner(L, W), Corner(-L, W), Corner(-L, -W)]


@dataclass(frozen=True)
class Strip(Rectangle):
    """Uniaxial strip, pulled at its short sides left and right."""

    half_length: float = 60.0
    half_width: float = 10.0
    far_size: float = 4.0
    name: ClassVar[str] = "strip"
    loaded: ClassVar[tuple[str, ...]] = ("left", "right")
    displacement: ClassVar[float | None] = 60.0


@dataclass(frozen=True)
class PureShearSheet(Rectangle):
    """Wide sheet, pulled at its long sides bottom and top."""

    half_length: float = 100.0
    half_width: float = 10.0
    far_size: float = 4.0
    name: ClassVar[str] = "pure_shear"
    loaded: ClassVar[tuple[str, ...]] = ("bottom", "top")
    displacement: ClassVar[float | None] = 10.0


@dataclass(frozen=True)
class SquareSheet(Rectangle):
    """Square sheet, pulled at all four sides."""

    half_length: float = 50.0
    half_width: float = 50.0
    far_size: float = 5.0
    name: ClassVar[str] = "square"
    loaded: ClassVar[tuple[str, ...]] = ("left", "right", "bottom", "top")
    displacement: ClassVar[float | None] = None  # the grips meet at its corners


@dataclass(frozen=True)
class PlateWithHole(Rectangle):
    """Plate with one circular hole in its centre, pulled at left and right."""

    half_length: float = 60.0
    half_width: float = 30.0
    far_size: float = 5.0
    hole_radius: float = 10.0
    hole_size: float = 1.5
    name: ClassVar[str] = "plate_with_hole"
    loaded: ClassVar[tuple[str, ...]] = ("left", "right")
    displacement: ClassVar[float | None] = 40.0

    @property
    def sizes(self) -> tuple[float, float]:
        return self.hole_size, self.far_size

    def holes(self) -> list[Ellipse]:
        return [Ellipse(0, 0, self.hole_radius, self.hole_radius)]
