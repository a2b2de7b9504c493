"""Effects of the catalogue that are in the material, as parts of a sheet that the forward model solves.

In: names, amplitudes and shapes in the convention of the catalogue. Out: a `Sheet`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibrate.effects.inclusion import half_axes, squareness
from forward.materials import Material
from forward.sheet import additions as laws
from forward.sheet.damage_and_dispersion import SquircularInclusion
from forward.sheet.multiplicative_viscosity import MaxwellBranch
from forward.sheet.thin_sheet import PermanentSet, Prony, Sheet

Values = Mapping[str, float]
Law = tuple[str, Mapping[str, float], Mapping[str, float]]


@dataclass(frozen=True)
class Extent:
    """Longest side of a test and its middle, mm."""

    size: float
    centre: tuple[float, float] = (0.0, 0.0)

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Of x and y in shares of the longest side from the middle, mm."""
        return self.centre[0] + self.size * x, self.centre[1] + self.size * y


def _inclusion(a: Values, s: Values, extent: Extent) -> laws.Addition:
    long, short, angle = half_axes(extent.size * s["radius"], s["e1"], s["e2"])
    square, turned = squareness(np.hypot(s["q1"], s["q2"])), np.arctan2(s["q2"], s["q1"]) / 4
    return SquircularInclusion(
        a["a"], *extent.place(s["x"], s["y"]), long, short, angle, float(square), float(turned - angle)
    )


ADDITIONS: Mapping[str, Callable[[Values, Values, Extent], laws.Addition]] = {
    "second invariant": lambda a, s, extent: laws.MooneyPart(a["c01"]),
    "upturn": lambda a, s, extent: laws.CubicPart(a["c30"]),
    "one fibre family": lambda a, s, extent: laws.Fibres(a["k"], (s["angle"],), s["k2"], s["kappa"]),
    "two fibre families": lambda a, s, extent: laws.Fibres(
        a["k"], (s["axis"] + s["half"], s["axis"] - s["half"]), s["k2"], s["kappa"]
    ),
    "stiffness gradient": lambda a, s, extent: laws.Gradient(a["gx"], a["gy"], extent.size, *extent.centre),
    "inclusion": _inclusion,
    "Mullins softening": lambda a, s, extent: laws.Mullins(a["r"], s["m"], s["beta"]),
    "Payne softening": lambda a, s, extent: laws.Payne(a["r"], s["x0"]),
}
CHANGES: Mapping[str, Callable[[Values, Values], dict[str, Any]]] = {
    "compressibility": lambda a, s: {"bulk_modulus": 1 / a["beta"]} if a["beta"] else {},
    "permanent set": lambda a, s: {"permanent_set": PermanentSet(a["a"])},
}
RELAXING = frozenset({"viscoelasticity", "second relaxation time"})
FLOWING = frozenset({"finite viscoelasticity", "second finite relaxation time"})
SOLVED = frozenset({*ADDITIONS, *CHANGES, *RELAXING, *FLOWING})


def sheet(
    material: Material, thickness: float, effects: Iterable[Law], extent: Extent, more: Iterable[laws.Addition] = ()
) -> Sheet:
    """A sheet with effects (name, amplitudes, shape). thickness, mm; more: further additions.

    Raises KeyError for an effect that is not in `SOLVED`, `MaterialError` for values that cannot be.
    """
    additions = list(more)
    prony: list[Prony] = []
    branches: list[MaxwellBranch] = []
    changes: dict[str, Any] = {}
    for name, amplitudes, shape in effects:
        if name in ADDITIONS:
            additions.append(ADDITIONS[name](amplitudes, shape, extent))
        elif name in RELAXING:
            prony.append(Prony(amplitudes["g"], shape["tau"]))
        elif name in FLOWING:
            branches.append(MaxwellBranch(amplitudes["mu"], shape["tau"]))
        else:
            changes |= CHANGES[name](amplitudes, shape)
    return Sheet(material, thickness, tuple(additions), tuple(prony), branches=tuple(branches), **changes)
