"""A thin sheet beyond the homogeneous, isotropic, elastic and incompressible one: base material and what it has beside it.

Additions act on energy or stress (`additions`). Viscosity, permanent set and compressibility change what is solved for
(`inelastic_problem`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from forward.errors import MaterialError
from forward.materials import Material
from forward.sheet.additions import Addition
from forward.sheet.multiplicative_viscosity import MaxwellBranch


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
    """A branch: overstress Q of the isochoric second Piola-Kirchhoff stress in three dimensions: Q' + Q / tau = g S_iso' (Simo 1987). tau in s.

    Raises `MaterialError`."""

    g: float
    tau: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.g) and math.isfinite(self.tau) and self.tau > 0):
            raise MaterialError(f"viscosity: g = {self.g}, tau = {self.tau} s; give finite numbers, tau > 0")


@dataclass(frozen=True)
class Sheet:
    """A thin sheet: base material, thickness (mm), additions, branches of viscosity (a Prony series), permanent set, bulk modulus (MPa) or
    incompressible, branches of finite viscoelasticity with a multiplicative split (beside the stress, not softened by it).

    Compressible: psi of the invariants of the volume-preserving part of F, and kappa / 2 (J - 1)^2. Raises
    `MaterialError`.
    """

    material: Material
    thickness: float = 1.0
    additions: tuple[Addition, ...] = ()
    prony: tuple[Prony, ...] = ()
    permanent_set: PermanentSet | None = None
    bulk_modulus: float | None = None
    branches: tuple[MaxwellBranch, ...] = ()

    def __post_init__(self) -> None:
        if not (math.isfinite(self.thickness) and self.thickness > 0):
            raise MaterialError(f"thickness {self.thickness} mm: give a positive number")
        if self.permanent_set is not None and self.bulk_modulus is not None:
            raise MaterialError("a compressible sheet has no permanent set here; give one of the two only")
        if self.branches and self.bulk_modulus is not None:
            raise MaterialError("a compressible sheet has no viscous branches here; give one of the two only")
        if self.bulk_modulus is not None and not (math.isfinite(self.bulk_modulus) and self.bulk_modulus > 0):
            raise MaterialError(f"bulk modulus {self.bulk_modulus} MPa: give a positive number, or none")

    @property
    def relaxes(self) -> bool:
        """Whether the stress depends on time."""
        return bool(self.prony or self.branches)

    @property
    def softens(self) -> bool:
        """Whether the stress depends on the largest deformation so far."""
        return self.permanent_set is not None or any(type(a).factor is not Addition.factor for a in self.additions)

    @property
    def softens_by_energy(self) -> bool:
        """Whether the stress depends on the largest energy so far."""
        return any(type(a).factor_of_energy is not Addition.factor_of_energy for a in self.additions)

    @property
    def elastic(self) -> Sheet:
        """Without what remembers, and incompressible."""
        remembering = (
            type(a).factor is not Addition.factor or type(a).factor_of_energy is not Addition.factor_of_energy
            for a in self.additions
        )
        additions = tuple(a for a, one in zip(self.additions, remembering, strict=True) if not one)
        return replace(self, additions=additions, prony=(), permanent_set=None, bulk_modulus=None, branches=())

    def energy(self, base: Any, I1: Any, I2: Any, C: Any, X: Any, additions: Sequence[Any]) -> Any:
        """Energy, MPa, without that of the volume. base: that of the material; C (2, 2), X (2,), mm; additions: their values as constants."""
        for addition, p in zip(self.additions, additions, strict=True):
            base += addition.energy(I1, I2, C, p) or 0
        return base * self.field(X, additions)

    def field(self, X: Any, additions: Sequence[Any]) -> Any:
        """Product of the fields s(X) at the reference place X (2,), mm."""
        found = (addition.field(X, p) for addition, p in zip(self.additions, additions, strict=True))
        return math.prod((s for s in found if s is not None), start=1)

    def factor(self, x: Any, largest: Any, additions: Sequence[Any]) -> Any:
        """Product of the factors on the stress at x = I1 - 3 and its largest value so far."""
        found = (addition.factor(x, largest, p) for addition, p in zip(self.additions, additions, strict=True))
        return math.prod((f for f in found if f is not None), start=1)

    def factor_of_energy(self, W: Any, largest: Any, additions: Sequence[Any]) -> Any:
        """Product of the factors on the stress at the energy W, MPa, and its largest value so far."""
        found = (
            addition.factor_of_energy(W, largest, p) for addition, p in zip(self.additions, additions, strict=True)
        )
        return math.prod((f for f in found if f is not None), start=1)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for a description."""
        return {
            "material": self.material.to_dict(),
            "thickness": self.thickness,
            "additions": [a.to_dict() for a in self.additions],
            "prony": [asdict(one) for one in self.prony],
            "permanent_set": None if self.permanent_set is None else asdict(self.permanent_set),
            "bulk_modulus": self.bulk_modulus,
            **({"branches": [asdict(branch) for branch in self.branches]} if self.branches else {}),
        }
