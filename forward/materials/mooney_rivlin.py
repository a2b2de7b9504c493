"""The solid by Mooney and Rivlin: linear in both invariants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from forward.materials.strain_energy import Material


@dataclass(frozen=True)
class MooneyRivlin(Material):
    r"""Linear in both invariants.

    .. math:: \psi = c_{10} (I_1 - 3) + c_{01} (I_2 - 3)

    c10, c01: coefficients, MPa; the initial shear modulus is 2 (c10 + c01).

    Mooney 1940; Rivlin 1948.
    """

    c10: float = 0.12
    c01: float = 0.03
    name: ClassVar[str] = "mooney_rivlin"

    @property
    def shear_modulus(self) -> float:
        return 2 * (self.c10 + self.c01)

    def energy(self, I1: Any, I2: Any, parameters: Sequence[Any] | None = None) -> Any:
        c10, c01 = self.parameters if parameters is None else parameters
        return c10 * (I1 - 3) + c01 * (I2 - 3)
