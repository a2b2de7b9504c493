"""What a sheet may have beside its base material: each addition a small law in UFL.

An addition acts at one of three places of the stored energy or stress of the base material,

    P = (1 - D) d/dF { s(X) [psi + additions of energy] },

an energy (fibres, a second invariant), a field s(X) over the sheet, or a factor 1 - D that depends on x = I1 - 3, or on
the energy, and on its largest value so far. Values reach the forms as constants, so that one compilation serves every value of them.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

from forward._dolfinx import ufl
from forward.errors import MaterialError

LINEAR_BETA = 100.0  # of Mullins softening, from which on it is linear
STRAIGHT = 1e-6  # k2 E^2 of fibres, below which they are of standard reinforcement


@dataclass(frozen=True)
class Addition:
    """Base of the additions, each of which overrides one of the laws. Raises `MaterialError`."""

    name: ClassVar[str]
    positive: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        for key, value in asdict(self).items():
            for number in value if isinstance(value, tuple) else (value,):
                if not math.isfinite(number) or (key in self.positive and number <= 0):
                    raise MaterialError(f"{self.name}: {key} = {value}; give finite numbers, lengths and times > 0")

    @property
    def values(self) -> tuple[float, ...]:
        """Numbers in the order that the laws read them."""
        return tuple(float(v) for v in asdict(self).values())

    def energy(self, I1: Any, I2: Any, C: Any, p: Any) -> Any:
        """Energy, MPa, to be added; C (2, 2): in-plane right Cauchy-Green tensor, p: `values`. None: nothing is added.

        All in UFL, as in the other laws.
        """
        return None

    def field(self, X: Any, p: Any) -> Any:
        """Factor on the energy at the reference place X (2,), mm; None: there is none."""
        return None

    def factor(self, x: Any, largest: Any, p: Any) -> Any:
        """Factor on the stress at x = I1 - 3 and its largest value so far, the present one included; None: there is
        none."""
        return None

    def factor_of_energy(self, W: Any, largest: Any, p: Any) -> Any:
        """The same at the stored energy W, MPa, of what is not damaged, and its largest value so far."""
        return None

    def to_dict(self) -> dict[str, Any]:
        """Name and values, for a description."""
        return {"effect": self.name, **asdict(self)}


@dataclass(frozen=True)
class MooneyPart(Addition):
    """psi + c01 (I2 - 3), c01 in MPa."""

    c01: float
    name: ClassVar[str] = "Mooney part"

    def energy(self, I1, I2, C, p):
        return p[0] * (I2 - 3)


@dataclass(frozen=True)
class CubicPart(Addition):
    """psi + c30 (I1 - 3)^3, c30 in MPa."""

    c30: float
    name: ClassVar[str] = "cubic part"

    def energy(self, I1, I2, C, p):
        return p[0] * (I1 - 3) ** 3


@dataclass(frozen=True)
class Fibres(Addition):
    """psi + k / (2 k2) sum (exp(k2 E^2) - 1), E = I4 - 1 + kappa / (1 - 3 kappa) (I1 - 3), I4 = M . C M, of families at `angles` (rad) to x; k in MPa
    (Holzapfel, Gasser and Ogden 2000; kappa: Gasser, Ogden and Holzapfel 2006, with k1 = k / (1 - 3 kappa)^2), here in compression, too.
    k2 = kappa = 0: k / 2 sum (I4 - 1)^2 (Qiu and Pence 1997).
    """

    k: float
    angles: tuple[float, ...]
    k2: float = 0.0
    kappa: float = 0.0
    name: ClassVar[str] = "fibres"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.k2 < 0:
            raise MaterialError(f"{self.name}: k2 = {self.k2}; give k2 >= 0")
        if not 0 <= self.kappa < 1 / 3:
            raise MaterialError(f"{self.name}: kappa = {self.kappa}; give a number from 0 to below 1/3")

    @property
    def values(self) -> tuple[float, ...]:
        return (self.k, max(self.k2, 1e-8), self.kappa / (1 - 3 * self.kappa), *self.angles)

    def energy(self, I1, I2, C, p):
        families = []
        for i in range(len(self.angles)):
            M = ufl.as_vector([ufl.cos(p[3 + i]), ufl.sin(p[3 + i])])
            square = (ufl.dot(M, C * M) - 1 + p[2] * (I1 - 3)) ** 2
            curved = (ufl.exp(p[1] * square) - 1) / p[1]
            families.append(ufl.conditional(ufl.lt(p[1] * square, STRAIGHT), square * (1 + p[1] * square / 2), curved))
        return p[0] / 2 * sum(families)


@dataclass(frozen=True)
class Gradient(Addition):
    """s = 1 + (gx (x - x0) + gy (y - y0)) / length; length, x0, y0 in mm."""

    gx: float
    gy: float
    length: float
    x0: float = 0.0
    y0: float = 0.0
    name: ClassVar[str] = "gradient"
    positive: ClassVar[tuple[str, ...]] = ("length",)

    def field(self, X, p):
        return 1 + (p[0] * (X[0] - p[3]) + p[1] * (X[1] - p[4])) / p[2]


@dataclass(frozen=True)
class CosineField(Addition):
    """s = 1 + sum a_kl cos(k pi (x - x0) / width) cos(l pi (y - y0) / height), k and l from 0 to `order`, without a_00.

    box: x0, y0, width, height, mm; coefficients: a_01, a_02, ..., a_10, ...
    """

    box: tuple[float, float, float, float]
    coefficients: tuple[float, ...]
    name: ClassVar[str] = "cosine field"

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.order + 1) ** 2 != len(self.coefficients) + 1 or min(self.box[2:]) <= 0:
            raise MaterialError(f"{self.name}: {len(self.coefficients)} coefficients in a box of {self.box[2:]} mm")

    @property
    def order(self) -> int:
        """Largest number of half waves along a side."""
        return math.isqrt(len(self.coefficients))

    @property
    def values(self) -> tuple[float, ...]:
        """The box, then the coefficients."""
        return (*self.box, *self.coefficients)

    def field(self, X, p):
        n = self.order + 1
        along = [ufl.cos(k * math.pi * (X[0] - p[0]) / p[2]) for k in range(n)]
        across = [ufl.cos(k * math.pi * (X[1] - p[1]) / p[3]) for k in range(n)]
        waves = [a * b for a in along for b in across][1:]
        return 1 + sum(p[4 + i] * wave for i, wave in enumerate(waves))


@dataclass(frozen=True)
class Patch(Addition):
    """s = 1 + height exp(-r^2 / (2 width^2)), r: distance from (x, y), mm."""

    height: float
    x: float
    y: float
    width: float
    name: ClassVar[str] = "patch"
    positive: ClassVar[tuple[str, ...]] = ("width",)

    def field(self, X, p):
        return 1 + p[0] * ufl.exp(-((X[0] - p[1]) ** 2 + (X[1] - p[2]) ** 2) / (2 * p[3] ** 2))


@dataclass(frozen=True)
class Mullins(Addition):
    """P (1 - r erf((x_max - x) / (m + beta x_max)) / erf(1 / beta)): softer the further below the largest deformation so far; the form of Ogden and
    Roxburgh (1999; beta: Mars 2004) in x in the place of the energy. As it stands here without m and beta: 1 - r (1 - x / x_max), within 2e-5 of r.

    m >= 0, beta > 0. The energy in the place of x: `damage_and_dispersion.OgdenRoxburgh`.
    """

    r: float
    m: float = 0.0
    beta: float = LINEAR_BETA
    name: ClassVar[str] = "Mullins"
    positive: ClassVar[tuple[str, ...]] = ("beta",)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.m < 0:
            raise MaterialError(f"{self.name}: m = {self.m}; give m >= 0")

    def factor(self, x, largest, p):
        below = (largest - x) / (p[1] + p[2] * ufl.max_value(largest, 1e-12))
        return 1 - p[0] * ufl.erf(below) / ufl.erf(1 / p[2])


@dataclass(frozen=True)
class Payne(Addition):
    """P (1 + r exp(-x_max / x0)): stiffer where it was never much deformed."""

    r: float
    x0: float
    name: ClassVar[str] = "Payne"
    positive: ClassVar[tuple[str, ...]] = ("x0",)

    def factor(self, x, largest, p):
        return 1 + p[0] * ufl.exp(-largest / p[1])
