"""Materials: the invariants of an incompressible solid in, its strain energy in MPa out; all else is derived.

A material is only its energy psi(I1, I2), with I1 = tr C, I2 = (I1^2 - tr C^2) / 2 and det C = 1, zero at rest.
It works on UFL expressions and on numbers alike. `energy` takes the parameters as an argument, so that the
compiled form serves every value of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass
from typing import Any, ClassVar

from forward.errors import MaterialError

ARRUDA_BOYCE = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)


@dataclass(frozen=True)
class Material:
    """Base of the materials. Raises `MaterialError` if a parameter is no finite number, or the solid has no
    stiffness at rest."""

    name: ClassVar[str]
    unit = "MPa"

    def __post_init__(self) -> None:
        for key, value in asdict(self).items():
            if not (isinstance(value, (int, float)) and math.isfinite(value)):
                raise MaterialError(f"{self.name}: {key} = {value}; give a finite number")
        if not self.shear_modulus > 0:
            raise MaterialError(f"{self.name}: the shear modulus is {self.shear_modulus:g} MPa, it must be positive")

    @property
    def parameters(self) -> tuple[float, ...]:
        """Parameters in the order of `energy`."""
        return tuple(float(value) for value in astuple(self))

    @property
    def shear_modulus(self) -> float:
        """Initial shear modulus 2 (psi_1 + psi_2) at rest, MPa."""
        raise NotImplementedError

    def energy(self, I1: Any, I2: Any, parameters: Sequence[Any] | None = None) -> Any:
        """Strain energy, MPa, at invariants `I1`, `I2`."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Name and parameters, for a manifest; `material_from_dict` reads it."""
        return {"material": self.name, **asdict(self)}


@dataclass(frozen=True)
class ArrudaBoyce(Material):
    r"""psi = mu sum_k c_k / N^(k-1) (I1^k - 3^k): eight chains, five terms (Arruda and Boyce 1993; Steinmann,
    Hossain and Possart 2012). mu in MPa; N: segments of a chain. The initial shear modulus is larger than mu.
    """

    mu: float = 0.2698
    N: float = 21.49
    name: ClassVar[str] = "arruda_boyce"

    @property
    def shear_modulus(self) -> float:
        return sum(2 * self.mu * c * k * 3 ** (k - 1) / self.N ** (k - 1) for k, c in enumerate(ARRUDA_BOYCE, 1))

    def energy(self, I1: Any, I2: Any, parameters: Sequence[Any] | None = None) -> Any:
        mu, N = self.parameters if parameters is None else parameters
        return mu * sum(c / N ** (k - 1) * (I1**k - 3**k) for k, c in enumerate(ARRUDA_BOYCE, 1))


@dataclass(frozen=True)
class NeoHooke(Material):
    """psi = mu / 2 (I1 - 3) (Rivlin 1948). mu in MPa."""

    mu: float = 0.3
    name: ClassVar[str] = "neo_hooke"

    @property
    def shear_modulus(self) -> float:
        return self.mu

    def energy(self, I1: Any, I2: Any, parameters: Sequence[Any] | None = None) -> Any:
        (mu,) = self.parameters if parameters is None else parameters
        return mu / 2 * (I1 - 3)


@dataclass(frozen=True)
class MooneyRivlin(Material):
    """psi = c10 (I1 - 3) + c01 (I2 - 3) (Mooney 1940; Rivlin 1948). c10, c01 in MPa."""

    c10: float = 0.12
    c01: float = 0.03
    name: ClassVar[str] = "mooney_rivlin"

    @property
    def shear_modulus(self) -> float:
        return 2 * (self.c10 + self.c01)

    def energy(self, I1: Any, I2: Any, parameters: Sequence[Any] | None = None) -> Any:
        c10, c01 = self.parameters if parameters is None else parameters
        return c10 * (I1 - 3) + c01 * (I2 - 3)


@dataclass(frozen=True)
class Yeoh(Material):
    """psi = c1 (I1 - 3) + c2 (I1 - 3)^2 + c3 (I1 - 3)^3 (Yeoh 1993). c1, c2, c3 in MPa."""

    c1: float = 0.15
    c2: float = -1e-3
    c3: float = 1e-4
    name: ClassVar[str] = "yeoh"

    @property
    def shear_modulus(self) -> float:
        return 2 * self.c1

    def energy(self, I1: Any, I2: Any, parameters: Sequence[Any] | None = None) -> Any:
        c1, c2, c3 = self.parameters if parameters is None else parameters
        x = I1 - 3
        return c1 * x + c2 * x**2 + c3 * x**3


MATERIALS: dict[str, type[Material]] = {kind.name: kind for kind in (ArrudaBoyce, NeoHooke, MooneyRivlin, Yeoh)}


def material_from_dict(content: dict[str, Any]) -> Material:
    """Material from `Material.to_dict()`. Raises `MaterialError` naming what is unknown."""
    parameters = dict(content)
    name = parameters.pop("material", None)
    if name == "pann":
        from forward.network_energy import Pann

        return Pann.from_dict(parameters)
    if name not in MATERIALS:
        raise MaterialError(f"material '{name}' is unknown; choose one of {', '.join(MATERIALS)}, pann")
    try:
        return MATERIALS[name](**parameters)
    except TypeError as error:
        raise MaterialError(f"{name}: {error}") from error
