"""Terms of an isochoric strain energy W(I1, I2), as plain tables that any language can carry.

Invariants are those of the isochoric part of C (det = 1), 3 at rest. Energies are in the unit of the model (MPa, or N/mm), zero at
rest. `PowerTerm`: classical laws; `SplineTerm`: the base of a diagnosis; `NetworkTerm`: a calibrated network.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibrate.equations.basis import SingleBasis
from calibrate.equations.inputs import INPUT_SETS, REFERENCE
from calibrate.equations.splines import DEGREE, pieces_of
from calibrate.models.network_model import Model

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PowerTerm:
    """coefficient ((I - shift)^exponent - (3 - shift)^exponent), I the invariant 1 or 2; shift is 0 or 3."""

    coefficient: float
    invariant: int = 1
    exponent: float = 1.0
    shift: float = 3.0


@dataclass(frozen=True)
class SplineTerm:
    """Integral over J of a cubic spline in s = sqrt((J - J at rest) / top), constant beyond s = 1; J is I1 or I2^(3/2).

    coefficients (n,): of clamped uniform B-splines, as `calibrate.equations.basis.SingleBasis` has them.
    """

    invariant: int
    top: float
    coefficients: tuple[float, ...]

    @classmethod
    def of(cls, basis: SingleBasis, c: Array) -> SplineTerm:
        """The same energy, of coefficients c (n,)."""
        return cls(basis.k + 1, basis.top, tuple(map(float, c)))

    @cached_property
    def pieces(self) -> Array:
        """(n - 3, 4): dW/dJ = sum_p pieces[i, p] t^p on interval i, t = (n - 3) s - i from 0 to 1."""
        return pieces_of(np.asarray(self.coefficients))

    @cached_property
    def energies(self) -> Array:
        """(n - 2,): W at the ends of the intervals; dJ = 2 top s ds with s = (i + t) / (n - 3)."""
        m, p = len(self.pieces), np.arange(DEGREE + 1)
        first = np.arange(m)[:, None]
        parts = self.pieces * (first / (p + 1) + 1 / (p + 2))
        return np.concatenate([[0.0], np.cumsum(2 * self.top / m**2 * parts.sum(axis=1))])

    @property
    def rest(self) -> float:
        """J at rest."""
        return float(REFERENCE[self.invariant - 1])


@dataclass(frozen=True)
class NetworkTerm:
    """energy_scale (w . z_K + v . x) minus its value at rest, z_k = softplus(W_k z_(k-1) + b_k), x = scales (J - J at rest).

    invariants: which of J1 = I1 and J2 = I2^(3/2) go in. values: W (row by row) and b of each layer, w, v.
    """

    invariants: tuple[int, ...]
    scales: tuple[float, ...]
    energy_scale: float
    layers: tuple[int, ...]
    values: tuple[float, ...]

    @classmethod
    def of(cls, model: Model) -> NetworkTerm:
        """The network of a calibrated model."""
        a = model.architecture
        used = INPUT_SETS[a.inputs]
        return cls(
            tuple(i + 1 for i in used), tuple(a.scales[i] for i in used), a.energy_scale, tuple(a.layers),
            tuple(map(float, model.parameters)),
        )  # fmt: skip

    @property
    def hidden(self) -> list[tuple[Array, Array]]:
        """W and b of each layer."""
        found, n, at = [], len(self.invariants), 0
        for width in self.layers:
            W = np.reshape(self.values[at : at + width * n], (width, n))
            found.append((W, np.array(self.values[at + width * n : at + width * n + width])))
            at, n = at + width * (n + 1), width
        return found

    @property
    def output(self) -> tuple[float, ...]:
        """w, then v."""
        return self.values[-self.layers[-1] - len(self.invariants) :]


Term = PowerTerm | SplineTerm | NetworkTerm
