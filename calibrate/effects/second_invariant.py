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
        J, trace = F.det, F.dot(F)
        slope = F * J**-2 + F.cofactor * (J - trace * J**-3)  # half of that of I2 = J^2 + tr F^T F / J^2
        return (Tensors.of(P) + slope * (2.0 * a[0])).array
