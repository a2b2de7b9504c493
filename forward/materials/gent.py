"""The solid by Gent: chains that cannot be stretched further."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from forward.errors import MaterialError
from forward.materials.elementary import logarithm
from forward.materials.strain_energy import Material


@dataclass(frozen=True)
class Gent(Material):
    r"""Limited extensibility.

    .. math:: \psi = -\frac{\mu J_m}{2} \ln\left(1 - \frac{I_1 - 3}{J_m}\right)

    mu: initial shear modulus, MPa. Jm: I1 - 3 at which the stress is infinite; no state reaches it.

    Gent 1996 (Rubber Chem. Technol. 69). Raises `MaterialError` unless Jm is positive.
    """

    mu: float = 0.3
    Jm: float = 40.0
    name: ClassVar[str] = "gent"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.Jm <= 0:
            raise MaterialError(f"gent: Jm = {self.Jm:g}; give a positive number")

    @property
    def shear_modulus(self) -> float:
        return self.mu

    def energy(self, I1: Any, I2: Any, parameters: Sequence[Any] | None = None) -> Any:
        mu, Jm = self.parameters if parameters is None else parameters
        return -mu * Jm / 2 * logarithm(1 - (I1 - 3) / Jm)
