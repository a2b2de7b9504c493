"""Second invariant: psi + c01 (I2 - 3), the Mooney part of a rubber's energy (Rivlin 1948)."""

from __future__ import annotations

from dataclasses import dataclass

from calibrate.effects.effect import Effect, Parameter
from calibrate.equations.tensors import Tensors


@dataclass(frozen=True)
class SecondInvariant(Effect):
    """P gains c01 dI2/dF."""

    name = "second invariant"
    stage = "energy"
    of_material = True
    formula = "psi + c01 (I2 - 3)"
    source = "Mooney 1940; Rivlin 1948"
    amplitudes = (Parameter("c01", "MPa", lower=0.0, typical=0.03),)
    decided_by = "an equi-biaxial test beside a uniaxial one"

    def stress(self, data, F, P, a, shape):
        F = Tensors.of(F)
        return (Tensors.of(P) + _half_slope(F) * (2.0 * a[0])).array


@dataclass(frozen=True)
class SecondInvariantLogarithm(Effect):
    """P gains c2 / I2 dI2/dF: another form of the same, by which the bands of curves allow for what a test cannot tell of its form."""

    name = "second invariant, logarithmic"
    stage = "energy"
    of_material = True
    formula = "psi + c2 ln(I2 / 3)"
    source = "Gent and Thomas 1958"
    amplitudes = (Parameter("c2", "MPa", lower=0.0, typical=0.09),)
    decided_by = "an equi-biaxial test beside a uniaxial one"

    def stress(self, data, F, P, a, shape):
        F = Tensors.of(F)
        J = F.det
        return (Tensors.of(P) + _half_slope(F) * (2.0 * a[0] / (J**2 + F.dot(F) * J**-2))).array


def _half_slope(F: Tensors) -> Tensors:
    """Half of that of I2 = J^2 + tr F^T F / J^2."""
    J = F.det
    return F * J**-2 + F.cofactor * (J - F.dot(F) * J**-3)
