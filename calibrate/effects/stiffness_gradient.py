"""Stiffness or thickness that varies linearly over the sheet."""

from __future__ import annotations

from dataclasses import dataclass

from calibrate.effects.effect import Effect, Parameter


@dataclass(frozen=True)
class StiffnessGradient(Effect):
    """P times 1 + gx x + gy y, x and y in units of the extent."""

    name = "stiffness gradient"
    stage = "stiffness"
    formula = "P (1 + gx x + gy y)"
    amplitudes = tuple(Parameter(name, "1/extent", lower=-1.5, upper=1.5, typical=0.2) for name in ("gx", "gy"))
    nested_in = "stiffness field"
    decided_by = "strips cut from different places, or a thickness gauge"

    def stress(self, data, F, P, a, shape):
        return P * (1.0 + (data.centroids - data.centre) / data.size @ a)[:, None, None]
