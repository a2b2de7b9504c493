r"""A law whose energy derivative is a cubic spline: the base of a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from forward.errors import MaterialError
from forward.materials.strain_energy import Material

Piece = tuple[float, float, float, float]
NEXT_TO_REST = 1e-14  # added to (I1 - 3) / top, since the root has no slope at rest


@dataclass(frozen=True)
class SplineEnergy(Material):
    r"""Energy of the first invariant, exactly that of its spline.

    .. math:: \psi = \int_3^{I_1} f \, dI, \qquad f = \sum_p c_{ip} t^p, \quad t = m s - i \in [0, 1], \quad s = \sqrt{(I_1 - 3) / top}

    pieces (m, 4): c, MPa, of the intervals i of s from 0 to 1, which meet with their second derivatives; beyond, f is constant. With
    truncated powers, f = sum_p c_0p (m s)^p + sum_i (c_i3 - c_(i-1)3) m^3 (s - i / m)_+^3 (de Boor 1978), and dI = 2 top s ds.
    """

    top: float
    pieces: tuple[Piece, ...]
    name: ClassVar[str] = "spline"

    def __post_init__(self) -> None:
        if not self.top > 0 or not self.pieces or not np.isfinite([self.top, *np.ravel(self.pieces)]).all():
            raise MaterialError("spline: give a positive top and finite pieces of four numbers")
        if not self.shear_modulus > 0:
            raise MaterialError(f"spline: the shear modulus is {self.shear_modulus:g} MPa, it must be positive")

    @classmethod
    def from_dict(cls, parameters: dict[str, Any]) -> Self:
        """Material from its parameters by name. Raises `MaterialError` for a name it does not have."""
        pieces = tuple(tuple(map(float, piece)) for piece in parameters.get("pieces", ()))
        return super().from_dict({**parameters, "pieces": pieces})

    @property
    def parameters(self) -> tuple[float, ...]:
        """top, then the pieces: all are constants of compiled code, which then serves every spline of as many pieces."""
        return (self.top, *(float(c) for piece in self.pieces for c in piece))

    @property
    def shear_modulus(self) -> float:
        return 2 * self.pieces[0][0]

    def energy(self, I1: Any, I2: Any, parameters: Sequence[Any] | None = None) -> Any:
        top, *c = self.parameters if parameters is None else parameters
        place = ((I1 - 3) / top + NEXT_TO_REST) ** 0.5
        s, m = place - _ramp(place - 1), len(self.pieces)
        inside = sum(c[p] * m**p * s ** (p + 2) / (p + 2) for p in range(4))
        for i in range(1, m):
            beyond = _ramp(s - i / m)
            jump = (c[4 * i + 3] - c[4 * i - 1]) * m**3
            inside = inside + jump * beyond**4 * (beyond / 5 + i / (4 * m))
        return 2 * top * inside + sum(c[4 * m - 4 + p] for p in range(4)) * _ramp(I1 - 3 - top)


def _ramp(x: Any) -> Any:
    """x where positive, else 0."""
    return (x + abs(x)) / 2
