"""The solid by Carroll: vulcanised rubber in three terms, one of them the root of the second invariant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any, ClassVar

from forward.materials.strain_energy import Material


@dataclass(frozen=True)
class Carroll(Material):
    r"""Three terms in both invariants.

    .. math:: \psi = a (I_1 - 3) + b (I_1^4 - 81) + c (\sqrt{I_2} - \sqrt 3)

    a, b, c: coefficients, MPa. The energy is concave in the second invariant, so that no network which is convex in it has it as a
    limit.

    Carroll 2011 (J. Elast. 103). Default values: fitted here to the uniaxial, equi-biaxial and pure-shear tension of Treloar
    (1944), squares weighted by 1 / stress.
    """

    a: float = 0.13889
    b: float = 2.945e-7
    c: float = 0.13481
    name: ClassVar[str] = "carroll"

    @property
    def shear_modulus(self) -> float:
        return 2 * (self.a + 108 * self.b + self.c / (2 * sqrt(3)))

    def energy(self, I1: Any, I2: Any, parameters: Sequence[Any] | None = None) -> Any:
        a, b, c = self.parameters if parameters is None else parameters
        return a * (I1 - 3) + b * (I1**4 - 81) + c * (I2**0.5 - sqrt(3))
