"""The solid by Yeoh: a cubic in the first invariant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from forward.materials.strain_energy import Material


@dataclass(frozen=True)
class Yeoh(Material):
    r"""A cubic in the first invariant.

    .. math:: \psi = c_1 (I_1 - 3) + c_2 (I_1 - 3)^2 + c_3 (I_1 - 3)^3

    c1, c2, c3: coefficients, MPa; the initial shear modulus is 2 c1.

    Yeoh 1993.
    """

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
