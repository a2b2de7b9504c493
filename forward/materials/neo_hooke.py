"""The neo-Hookean solid: Gaussian chains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from forward.materials.strain_energy import Material


@dataclass(frozen=True)
class NeoHooke(Material):
    r"""Gaussian chains.

    .. math:: \psi = \frac{\mu}{2} (I_1 - 3)

    mu: shear modulus, MPa.

    Rivlin 1948.
    """

    mu: float = 0.3
    name: ClassVar[str] = "neo_hooke"

    @property
    def shear_modulus(self) -> float:
        return self.mu

    def energy(self, I1: Any, I2: Any, parameters: Sequence[Any] | None = None) -> Any:
        (mu,) = self.parameters if parameters is None else parameters
        return mu / 2 * (I1 - 3)
