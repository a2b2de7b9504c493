"""Additions of foreign trials: damage by the energy, fibres that are not all parallel, a power of the principal stretches, and inclusions with a sharp edge.

No effect of the diagnosis has their whole formula, but for the squircle: its own softening follows damage by the energy on a neo-Hookean sheet alone, its own fibres those in tension.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from forward._dolfinx import ufl
from forward.errors import MaterialError
from forward.materials import Ogden
from forward.sheet.additions import Addition

TRIANGLE = float(np.sqrt(np.pi / (3 * np.sqrt(3))))  # radius of the circle within an equilateral triangle of area pi


@dataclass(frozen=True)
class DispersedFibres(Addition):
    """psi + k1 / (2 k2) sum (exp(k2 <E>^2) - 1), E = kappa (I1 - 3) + (1 - 3 kappa) (I4 - 1), <E> = max(E, 0), of families at `angles`
    (rad) to x; k1 in MPa (Gasser, Ogden and Holzapfel 2006).

    kappa: dispersion, 0: all in one direction, 1/3: isotropic.
    """

    k1: float
    k2: float
    kappa: float
    angles: tuple[float, ...]
    name: ClassVar[str] = "dispersed fibres"
    positive: ClassVar[tuple[str, ...]] = ("k2",)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.kappa <= 1 / 3:
            raise MaterialError(f"{self.name}: kappa = {self.kappa}; give a number from 0 to 1/3")

    @property
    def values(self) -> tuple[float, ...]:
        return (self.k1, self.k2, self.kappa, *self.angles)

    def energy(self, I1, I2, C, p):
        families = []
        for i in range(len(self.angles)):
            M = ufl.as_vector([ufl.cos(p[3 + i]), ufl.sin(p[3 + i])])
            E = p[2] * (I1 - 3) + (1 - 3 * p[2]) * (ufl.dot(M, C * M) - 1)
            families.append(ufl.exp(p[1] * ufl.max_value(E, 0.0) ** 2) - 1)
        return p[0] / (2 * p[1]) * sum(families)


@dataclass(frozen=True)
class OgdenRoxburgh(Addition):
    """P (1 - erf((W_max - W) / (m + beta W_max)) / r): damage by the energy W of the whole law (Ogden and Roxburgh 1999; beta: Mars 2004).

    r >= 1; m in MPa, beta >= 0, not both 0.
    """

    r: float
    m: float
    beta: float = 0.0
    name: ClassVar[str] = "Ogden-Roxburgh"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.r < 1 or min(self.m, self.beta) < 0 or self.m + self.beta == 0:
            raise MaterialError(f"{self.name}: r = {self.r}, m = {self.m} MPa, beta = {self.beta}; give r >= 1 and "
                                "m, beta >= 0, not both 0")  # fmt: skip

    def factor_of_energy(self, W, largest, p):
        scale = ufl.max_value(p[1] + p[2] * largest, 1e-12)
        return 1 - ufl.erf((largest - W) / scale) / p[0]


@dataclass(frozen=True)
class OgdenPart(Addition):
    """psi + mu / alpha (sum lambda^alpha - 3), mu in MPa: one term of `forward.materials.Ogden` beside any material."""

    mu: float
    alpha: float
    name: ClassVar[str] = "Ogden part"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.alpha == 0:
            raise MaterialError(f"{self.name}: alpha = 0; give another exponent")

    def energy(self, I1, I2, C, p):
        return Ogden().energy(I1, I2, (p[0], p[1], 0.0, 1.0, 0.0, 1.0))


@dataclass(frozen=True)
class _Inclusion(Addition):
    """s = 1 + height within an outline around (x, y), and 1 outside. long, short: half its length and width, mm; angle, rad: of the length to x."""

    height: float
    x: float
    y: float
    long: float
    short: float
    angle: float
    positive: ClassVar[tuple[str, ...]] = ("long", "short")

    def field(self, X, p):
        x, y, c, s = X[0] - p[1], X[1] - p[2], ufl.cos(p[5]), ufl.sin(p[5])
        inside = self.inside((c * x + s * y) / p[3], (c * y - s * x) / p[4], p)
        return ufl.conditional(inside, 1 + p[0], 1.0)

    def inside(self, along: Any, across: Any, p: Any) -> Any:
        """UFL condition, of shares of half the length and width; p: parameters, in the order of the fields."""
        raise NotImplementedError


@dataclass(frozen=True)
class SquircularInclusion(_Inclusion):
    """A stretched squircle (Fernandez Guasti 1992) with the area of an ellipse of these half axes, to within 1 %: an ellipse for square = 0, a parallelogram for 1.

    turned: angle, rad, from the length to the normal of a side, both before the stretch; 0 gives a rectangle.
    """

    square: float = 0.0
    turned: float = 0.0
    name: ClassVar[str] = "squircular inclusion"

    def inside(self, along, across, p):
        fourth = along**4 - 6 * along**2 * across**2 + across**4
        other = 4 * along * across * (along**2 - across**2)
        squared = along**2 + across**2
        # of four times the angle to the normal of a side; at the middle, where there is none, 0 / tiny
        cosine = (ufl.cos(4 * p[7]) * fourth + ufl.sin(4 * p[7]) * other) / (squared**2 + 1e-30)
        root = ufl.sqrt(ufl.max_value(1 - p[6] * (1 - cosine) / 2, 0.0))
        area = ufl.exp(-p[6] / 8 - (np.log(4 / np.pi) - 1 / 8) * p[6] ** 4)
        return ufl.le(squared * (1 + root), 2 * area)


class RectangularInclusion(_Inclusion):
    """A rectangle with these half sides."""

    name: ClassVar[str] = "rectangular inclusion"

    def inside(self, along, across, p):
        return ufl.And(ufl.le(abs(along), 1.0), ufl.le(abs(across), 1.0))


class TriangularInclusion(_Inclusion):
    """A triangle of two equal sides, its tip along the length, with the area of an ellipse of these half axes."""

    name: ClassVar[str] = "triangular inclusion"

    def inside(self, along, across, p):
        sides = (
            ufl.le(np.cos(angle) * along + np.sin(angle) * across, TRIANGLE)
            for angle in np.pi / 3 * np.array([1.0, 3.0, 5.0])
        )
        return ufl.And(ufl.And(next(sides), next(sides)), next(sides))
