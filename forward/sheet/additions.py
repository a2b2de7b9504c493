"""What a sheet may be beyond a homogeneous, isotropic, elastic and incompressible one: each addition a small law in UFL.

An addition acts at one of three places of the stored energy or stress of the base material,

    P = (1 - D) d/dF { s(X) [psi + additions of energy] },

an energy (fibres, a second invariant), a field s(X) over the sheet, or a factor 1 - D that depends on x = I1 - 3 and on
its largest value so far. Viscosity, permanent set and compressibility change what is solved for and are read by `forward.sheet.inelastic`.
Values reach the forms as constants, so that one compilation serves every value of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

from forward._dolfinx import ufl
from forward.errors import MaterialError
from forward.materials import Material


@dataclass(frozen=True)
class Addition:
    """Base of the additions, each of which overrides one of the three laws. Raises `MaterialError`."""

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

        All in UFL, as in the other two laws.
        """
        return None

    def field(self, X: Any, p: Any) -> Any:
        """Factor on the energy at the reference place X (2,), mm; None: there is none."""
        return None

    def factor(self, x: Any, largest: Any, p: Any) -> Any:
        """Factor on the stress at x = I1 - 3 and its largest value so far, the present one included; None: there is
        none."""
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
class Fibres(Addition):
    """psi + k / 2 sum (I4 - 1)^2, I4 = M . C M, of families at `angles` (rad) to x; k in MPa (Qiu and Pence 1997)."""

    k: float
    angles: tuple[float, ...]
    name: ClassVar[str] = "fibres"

    @property
    def values(self) -> tuple[float, ...]:
        return (self.k, *self.angles)

    def energy(self, I1, I2, C, p):
        families = []
        for i in range(len(self.angles)):
            M = ufl.as_vector([ufl.cos(p[1 + i]), ufl.sin(p[1 + i])])
            families.append((ufl.dot(M, C * M) - 1) ** 2)
        return p[0] / 2 * sum(families)


@dataclass(frozen=True)
class Gradient(Addition):
    """s = 1 + (gx x + gy y) / length, x and y from the origin, mm."""

    gx: float
    gy: float
    length: float
    name: ClassVar[str] = "gradient"
    positive: ClassVar[tuple[str, ...]] = ("length",)

    def field(self, X, p):
        return 1 + (p[0] * X[0] + p[1] * X[1]) / p[2]


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
    """P (1 - r (1 - x / x_max)): softer the further below the largest deformation so far."""

    r: float
    name: ClassVar[str] = "Mullins"

    def factor(self, x, largest, p):
        return 1 - p[0] * (1 - x / ufl.max_value(largest, 1e-12))


@dataclass(frozen=True)
class Payne(Addition):
    """P (1 + r exp(-x_max / x0)): stiffer where it was never much deformed."""

    r: float
    x0: float
    name: ClassVar[str] = "Payne"
    positive: ClassVar[tuple[str, ...]] = ("x0",)

    def factor(self, x, largest, p):
        return 1 + p[0] * ufl.exp(-largest / p[1])


@dataclass(frozen=True)
class PermanentSet:
    """Of the chains, exp(-a x_max) are as made; those that broke on the way are formed anew without stress, in the state
    they broke in, as Gaussian chains with the shear modulus of the material (Tobolsky 1960). Raises
    `MaterialError`."""

    a: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.a) and self.a >= 0):
            raise MaterialError(f"permanent set: a = {self.a}; give a finite number that is not negative")


@dataclass(frozen=True)
class Prony:
    """Overstress Q of the in-plane second Piola-Kirchhoff stress S: Q' + Q / tau = g S' (Simo 1987). tau in s. Raises
    `MaterialError`."""

    g: float
    tau: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.g) and math.isfinite(self.tau) and self.tau > 0):
            raise MaterialError(f"viscosity: g = {self.g}, tau = {self.tau} s; give finite numbers, tau > 0")


@dataclass(frozen=True)
class Sheet:
    """A thin sheet: base material, thickness (mm), additions, viscosity, permanent set, bulk modulus (MPa) or
    incompressible.

    Compressible: psi of the invariants of the volume-preserving part of F, and kappa / 2 (J - 1)^2. Raises
    `MaterialError`.
    """

    material: Material
    thickness: float = 1.0
    additions: tuple[Addition, ...] = ()
    prony: Prony | None = None
    permanent_set: PermanentSet | None = None
    bulk_modulus: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.thickness) and self.thickness > 0):
            raise MaterialError(f"thickness {self.thickness} mm: give a positive number")
        if self.permanent_set is not None and self.bulk_modulus is not None:
            raise MaterialError("a compressible sheet has no permanent set here; give one of the two only")
        if self.bulk_modulus is not None and not (math.isfinite(self.bulk_modulus) and self.bulk_modulus > 0):
            raise MaterialError(f"bulk modulus {self.bulk_modulus} MPa: give a positive number, or none")

    @property
    def softens(self) -> bool:
        """Whether the stress depends on the largest deformation so far."""
        return self.permanent_set is not None or any(type(a).factor is not Addition.factor for a in self.additions)

    def energy(self, I1: Any, I2: Any, C: Any, X: Any, material: Any, additions: Sequence[Any]) -> Any:
        """Energy, MPa, without that of the volume; C (2, 2), X (2,), mm; material and additions: the values as
        constants."""
        psi = self.material.energy(I1, I2, material)
        for addition, p in zip(self.additions, additions, strict=True):
            psi += addition.energy(I1, I2, C, p) or 0
        return psi * self.field(X, additions)

    def field(self, X: Any, additions: Sequence[Any]) -> Any:
        """Product of the fields s(X) at the reference place X (2,), mm."""
        found = (addition.field(X, p) for addition, p in zip(self.additions, additions, strict=True))
        return math.prod((s for s in found if s is not None), start=1)

    def factor(self, x: Any, largest: Any, additions: Sequence[Any]) -> Any:
        """Product of the factors on the stress at x = I1 - 3 and its largest value so far."""
        found = (addition.factor(x, largest, p) for addition, p in zip(self.additions, additions, strict=True))
        return math.prod((f for f in found if f is not None), start=1)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for a description."""
        return {
            "material": self.material.to_dict(),
            "thickness": self.thickness,
            "additions": [a.to_dict() for a in self.additions],
            "prony": None if self.prony is None else asdict(self.prony),
            "permanent_set": None if self.permanent_set is None else asdict(self.permanent_set),
            "bulk_modulus": self.bulk_modulus,
        }
