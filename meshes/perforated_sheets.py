"""Thin sheets, 30 mm wide, pulled at their short sides: a uniaxial strip, perforated ones (TTa to TTf), and a wide sheet in pure shear.

In: dimensions and holes, mm. Out: specimens as in `meshes.specimens`. They stand in for the eight specimens of Abbasi et al.
(2026), whose drawings are not at hand: every dimension and hole is this project's choice.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import isclose, pi
from typing import Any, ClassVar

from meshes.errors import SpecimenError
from meshes.shapes import Ellipse
from meshes.specimens import PureShearSheet, Rectangle, Strip


@dataclass(frozen=True)
class UniaxialTension(Strip):
    """UT: a strip, held by rigid grips, so that its ends are not uniaxial."""

    half_length: float = 50.0
    half_width: float = 15.0
    far_size: float = 3.0
    name: ClassVar[str] = "UT"
    displacement: ClassVar[float | None] = 150.0


@dataclass(frozen=True)
class PureShear(PureShearSheet):
    """PS: a sheet six times as wide as it is high, so that its free sides are not in pure shear."""

    half_length: float = 60.0
    half_width: float = 10.0
    far_size: float = 3.0
    name: ClassVar[str] = "PS"
    displacement: ClassVar[float | None] = 15.0


@dataclass(frozen=True)
class PerforatedSheet(Rectangle):
    """Sheet with elliptic holes, pulled at its short sides left and right.

    perforation: holes of the first quadrant, mm and rad; those off an axis are mirrored at it, so that the sheet is symmetric to
    both. hole_size: mesh size at their rims, mm. Raises `SpecimenError` for a hole outside the first quadrant, or one on an
    axis that is not symmetric to it.
    """

    half_length: float = 50.0
    half_width: float = 15.0
    far_size: float = 3.0
    hole_size: float = 0.7
    perforation: tuple[Ellipse, ...] = (Ellipse(0.0, 0.0, 5.0, 5.0),)

    name: ClassVar[str] = "perforated_sheet"
    loaded: ClassVar[tuple[str, ...]] = ("left", "right")
    displacement: ClassVar[float | None] = 50.0

    def __post_init__(self) -> None:
        holes = tuple(hole if isinstance(hole, Ellipse) else Ellipse(**hole) for hole in self.perforation)
        object.__setattr__(self, "perforation", holes)
        super().__post_init__()

    @property
    def sizes(self) -> tuple[float, float]:
        return self.hole_size, self.far_size

    def dimensions(self) -> dict[str, float]:
        return {key: value for key, value in asdict(self).items() if key != "perforation"}

    def to_dict(self) -> dict[str, Any]:
        return {**super().to_dict(), "perforation": [asdict(hole) for hole in self.perforation]}

    def holes(self) -> list[Ellipse]:
        return [image for hole in self.perforation for image in _images(hole)]

    def _check_shape(self) -> None:
        for hole in self.perforation:
            where = f"{self.name}: the hole at ({hole.x:g}, {hole.y:g})"
            if hole.x < 0 or hole.y < 0 or not hole.a >= hole.b > 0:
                raise SpecimenError(
                    f"{where}: give x and y of at least 0 and semi-axes a >= b > 0; the rest is mirrored"
                )
            along = any(isclose(abs(hole.angle), turn, abs_tol=1e-9) for turn in (0, pi / 2, pi))
            if (hole.x == 0 or hole.y == 0) and hole.a != hole.b and not along:
                raise SpecimenError(f"{where} lies on an axis of symmetry; turn it by 0 or pi/2, not {hole.angle:g}")


def _images(hole: Ellipse) -> list[Ellipse]:
    """A hole and its mirror images, each once."""
    signs = [(sx, sy) for sx in ((1, -1) if hole.x else (1,)) for sy in ((1, -1) if hole.y else (1,))]
    return [Ellipse(sx * hole.x, sy * hole.y, hole.a, hole.b, sx * sy * hole.angle) for sx, sy in signs]


@dataclass(frozen=True)
class TTa(PerforatedSheet):
    """One small hole in a long sheet: uniaxial tension nearly everywhere."""

    half_length: float = 40.0
    perforation: tuple[Ellipse, ...] = (Ellipse(0.0, 0.0, 3.0, 3.0),)
    name: ClassVar[str] = "TTa"
    displacement: ClassVar[float | None] = 40.0


@dataclass(frozen=True)
class TTb(PerforatedSheet):
    """One large hole in a long sheet."""

    half_length: float = 40.0
    perforation: tuple[Ellipse, ...] = (Ellipse(0.0, 0.0, 6.0, 6.0),)
    name: ClassVar[str] = "TTb"
    displacement: ClassVar[float | None] = 36.0


@dataclass(frozen=True)
class TTc(PerforatedSheet):
    """A slit across the pull: large stretches ahead of its tips."""

    half_length: float = 30.0
    perforation: tuple[Ellipse, ...] = (Ellipse(0.0, 0.0, 9.0, 3.0, pi / 2),)
    name: ClassVar[str] = "TTc"
    displacement: ClassVar[float | None] = 26.0


@dataclass(frozen=True)
class TTd(PerforatedSheet):
    """Four slits in a sheet whose grips hinder its contraction."""

    half_length: float = 20.0
    perforation: tuple[Ellipse, ...] = (Ellipse(0.0, 7.5, 4.0, 2.5, pi / 2), Ellipse(10.0, 0.0, 6.0, 2.5, pi / 2))
    name: ClassVar[str] = "TTd"
    displacement: ClassVar[float | None] = 20.0


@dataclass(frozen=True)
class TTe(PerforatedSheet):
    """Two slits in a square: much of the middle in pure shear."""

    half_length: float = 15.0
    perforation: tuple[Ellipse, ...] = (Ellipse(0.0, 7.0, 4.5, 2.5, pi / 2),)
    name: ClassVar[str] = "TTe"
    displacement: ClassVar[float | None] = 15.0


@dataclass(frozen=True)
class TTf(PerforatedSheet):
    """Two holes in a sheet that is shorter than wide: from uniaxial tension to pure shear."""

    half_length: float = 12.5
    perforation: tuple[Ellipse, ...] = (Ellipse(0.0, 5.0, 3.0, 3.0),)
    name: ClassVar[str] = "TTf"
    displacement: ClassVar[float | None] = 12.0


SHEETS = (UniaxialTension, PureShear, TTa, TTb, TTc, TTd, TTe, TTf)
