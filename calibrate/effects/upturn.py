"""Upturn: psi + c30 (I1 - 3)^3, the stiffening of a network whose chains are nearly straight (Yeoh 1993).

A base of splines takes it up, so that it can be told only beside a base with few parameters, such as neo-Hooke, and where
the data reach far enough.
"""

from __future__ import annotations

from dataclasses import dataclass

from calibrate.effects.effect import Effect, Parameter
from calibrate.equations.tensors import Tensors


@dataclass(frozen=True)
class Upturn(Effect):
    """P gains 3 c30 (I1 - 3)^2 dI1/dF."""

    name = "upturn"
    stage = "energy"
    of_material = True
    formula = "psi + c30 (I1 - 3)^3"
    source = "Yeoh 1993"
    amplitudes = (Parameter("c30", "MPa", lower=0.0, typical=0.003),)
    decided_by = "a test to a larger stretch"

    def stress(self, data, F, P, a, shape):
        F = Tensors.of(F)
        J = F.det
        excess = F.dot(F) + J**-2 - 3.0
        slope = F - F.cofactor * J**-3  # half of that of I1 = tr F^T F + 1 / J^2
        return (Tensors.of(P) + slope * (6.0 * a[0] * excess**2)).array
