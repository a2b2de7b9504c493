r"""What every material is: a strain energy :math:`\psi(I_1, I_2)`, in MPa, zero at rest.

With the right Cauchy-Green tensor C of an isochoric deformation (det C = 1),

.. math:: I_1 = \operatorname{tr} C, \qquad I_2 = \tfrac12 (I_1^2 - \operatorname{tr} C^2).

An energy works on UFL expressions and on numbers alike. It takes the parameters as an argument, so that one compiled
form serves every value of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass
from typing import Any, ClassVar, Self

from forward.errors import MaterialError


@dataclass(frozen=True)
class Material:
    """Base of the materials: a frozen dataclass of its parameters.

    Raises `MaterialError` if a parameter is no finite number, or the solid has no stiffness at rest.
    """

    name: ClassVar[str]
    unit = "MPa"

    def __post_init__(self) -> None:
        for key, value in asdict(self).items():
            if not (isinstance(value, (int, float)) and math.isfinite(value)):
                raise MaterialError(f"{self.name}: {key} = {value}; give a finite number")
        if not self.shear_modulus > 0:
            raise MaterialError(f"{self.name}: the shear modulus is {self.shear_modulus:g} MPa, it must be positive")

    @classmethod
    def from_dict(cls, parameters: dict[str, Any]) -> Self:
        """Material from its parameters by name. Raises `MaterialError` for a name it does not have."""
        try:
            return cls(**parameters)
        except TypeError as error:
            raise MaterialError(f"{cls.name}: {error}") from error

    @property
    def parameters(self) -> tuple[float, ...]:
        """Parameters in the order of `energy`."""
        return tuple(float(value) for value in astuple(self))

    @property
    def shear_modulus(self) -> float:
        """Initial shear modulus 2 (dpsi/dI1 + dpsi/dI2) at rest, MPa."""
        raise NotImplementedError

    def energy(self, I1: Any, I2: Any, parameters: Sequence[Any] | None = None) -> Any:
        """Strain energy, MPa, at invariants `I1`, `I2`; `parameters`: in place of the material's own."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Name and parameters, for a manifest; `material_from_dict` reads it."""
        return {"material": self.name, **asdict(self)}
