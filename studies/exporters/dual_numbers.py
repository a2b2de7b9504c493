"""Numbers with first and second derivatives by two variables: what generated expressions are differentiated with.

rows (6, n): value, d1, d2, d11, d12, d22.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Dual:
    """n numbers with their derivatives, rows (6, n)."""

    rows: Array

    @classmethod
    def variable(cls, values: Array, which: int) -> Dual:
        """The first (0) or second (1) variable at values (n,)."""
        rows = np.zeros((6, len(values)))
        rows[0], rows[1 + which] = values, 1.0
        return cls(rows)

    @classmethod
    def of(cls, value: Any) -> Dual:
        """A dual number, or a constant."""
        return value if isinstance(value, Dual) else cls(np.array([[float(value)], *[[0.0]] * 5]))

    @property
    def value(self) -> Array:
        """Without derivatives (n,)."""
        return self.rows[0]

    def __add__(self, other: Any) -> Dual:
        return Dual(self.rows + Dual.of(other).rows)

    def __neg__(self) -> Dual:
        return Dual(-self.rows)

    def __sub__(self, other: Any) -> Dual:
        return self + -Dual.of(other)

    def __rsub__(self, other: Any) -> Dual:
        return -self + other

    def __mul__(self, other: Any) -> Dual:
        a, b = self.rows, Dual.of(other).rows
        found = a[0] * b + b[0] * a
        found[0] /= 2
        found[3] += 2 * a[1] * b[1]
        found[4] += a[1] * b[2] + a[2] * b[1]
        found[5] += 2 * a[2] * b[2]
        return Dual(found)

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: float) -> Dual:
        return Dual(self.rows / other)

    def __pow__(self, p: float) -> Dual:
        x = self.value
        second = p * (p - 1) * x ** (p - 2) if p * (p - 1) else 0 * x
        return self._applied(x**p, p * x ** (p - 1), second)

    def exp(self) -> Dual:
        """e to it."""
        e = np.exp(self.value)
        return self._applied(e, e, e)

    def log(self) -> Dual:
        """Natural logarithm."""
        return self._applied(np.log(self.value), 1 / self.value, -1 / self.value**2)

    def _applied(self, f: Array, df: Array, ddf: Array) -> Dual:
        a = self.rows
        squares = np.stack([a[1] ** 2, a[1] * a[2], a[2] ** 2])
        return Dual(np.concatenate([f[None], df * a[1:3], df * a[3:] + ddf * squares]))


def where(condition: Array, a: Any, b: Any) -> Dual:
    """a where a condition (n,) holds, else b."""
    return Dual(np.where(condition, Dual.of(a).rows, Dual.of(b).rows))
