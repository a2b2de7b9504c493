r"""A law without a formula: its energy derivatives are given by values at knots, with straight lines between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar, Self

import numpy as np

from forward.errors import MaterialError
from forward.materials.strain_energy import Material

Table = tuple[float, ...]


@dataclass(frozen=True)
class Tabulated(Material):
    r"""Energy derivatives from a table; a sum of a function of each invariant, smooth to its first derivative.

    .. math:: \psi = \int_3^{I_1} f_1 \, dI + \int_3^{I_2} f_2 \, dI, \qquad f_k \text{ piecewise linear}

    knots_1, knots_2: rising values of I1 - 3 and I2 - 3, the first 0; slopes_1, slopes_2: values of f_1 and f_2 there, MPa, which are
    the parameters in this order. Beyond the last knot f_k is constant.
    """

    knots_1: Table
    slopes_1: Table
    knots_2: Table = (0.0, 1.0)
    slopes_2: Table = (0.0, 0.0)
    name: ClassVar[str] = "tabulated"

    def __post_init__(self) -> None:
        for knots, slopes in ((self.knots_1, self.slopes_1), (self.knots_2, self.slopes_2)):
            if len(knots) != len(slopes) or len(knots) < 2 or not np.isfinite([*knots, *slopes]).all():
                raise MaterialError("tabulated: give as many finite slopes as knots, two at least")
            if knots[0] != 0 or not (np.diff(knots) > 0).all():
                raise MaterialError(f"tabulated: knots {knots} must rise from 0, which is the state at rest")
        if not self.shear_modulus > 0:
            raise MaterialError(f"tabulated: the shear modulus is {self.shear_modulus:g} MPa, it must be positive")

    @classmethod
    def from_dict(cls, parameters: dict[str, Any]) -> Self:
        """Material from its tables by name. Raises `MaterialError` for a name it does not have."""
        return super().from_dict({name: tuple(table) for name, table in parameters.items()})

    @property
    def parameters(self) -> tuple[float, ...]:
        return (*self.slopes_1, *self.slopes_2)

    @property
    def shear_modulus(self) -> float:
        return 2 * (self.slopes_1[0] + self.slopes_2[0])

    def energy(self, I1: Any, I2: Any, parameters: Sequence[Any] | None = None) -> Any:
        p, n = self.parameters if parameters is None else parameters, len(self.knots_1)
        first, second = [p[k] for k in range(n)], [p[n + k] for k in range(len(self.knots_2))]
        return _integral(I1 - 3, self.knots_1, first) + _integral(I2 - 3, self.knots_2, second)


def _integral(x: Any, knots: Table, slopes: Sequence[Any]) -> Any:
    """Integral from 0 to x of the straight lines through (knots, slopes): ramps that begin at the knots, integrated."""
    rise = [(b - a) / (z - y) for (a, b), (y, z) in zip(pairwise(slopes), pairwise(knots), strict=True)]
    changes = [rise[0], *(b - a for a, b in pairwise(rise)), -rise[-1]]
    return slopes[0] * x + sum(
        change * (x - knot + abs(x - knot)) ** 2 / 8 for change, knot in zip(changes, knots, strict=True)
    )
