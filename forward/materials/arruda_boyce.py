"""The eight-chain model of rubber by Arruda and Boyce, in five terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from forward.materials.strain_energy import Material

COEFFICIENTS = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)


@dataclass(frozen=True)
class ArrudaBoyce(Material):
    r"""Eight chains of finite length, their inverse Langevin function expanded to five terms.

    .. math:: \psi = \mu \sum_{k=1}^5 \frac{c_k}{N^{k-1}} (I_1^k - 3^k), \qquad
              c = \left(\tfrac12, \tfrac1{20}, \tfrac{11}{1050}, \tfrac{19}{7000}, \tfrac{519}{673750}\right)

    mu: shear modulus of the chains, MPa; the initial one of the solid is larger.
    N: segments of a chain.

    Arruda and Boyce 1993; default values of Steinmann, Hossain and Possart 2012.
    """

    mu: float = 0.2698
    N: float = 21.49
    name: ClassVar[str] = "arruda_boyce"

    @property
    def shear_modulus(self) -> float:
        return sum(2 * self.mu * c * k * 3 ** (k - 1) / self.N ** (k - 1) for k, c in enumerate(COEFFICIENTS, 1))

    def energy(self, I1: Any, I2: Any, parameters: Sequence[Any] | None = None) -> Any:
        mu, N = self.parameters if parameters is None else parameters
        return mu * sum(c / N ** (k - 1) * (I1**k - 3**k) for k, c in enumerate(COEFFICIENTS, 1))
