"""What passes between the links of a chain, by name, and the base model that they know.

Quantities: t increments, n nodes, m triangles, b loaded boundaries.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from calibrate.effects.chain.base_law import base_law
from calibrate.effects.chain.linearisation import Constants

MEASURED = "measured displacements"  # (t, n, 2), mm
DISPLACEMENTS = "displacements"  # (t, n, 2), mm, from the measured places of the nodes to where they truly are
PLACES = "reference places"  # (n, 2), mm, where the nodes truly were in the reference
TIME = "time"  # (t,), s, since the start of loading
GRADIENTS = "deformation gradients"  # (t, m, 2, 2), by the measured places of the reference
ELASTIC = "elastic deformation gradients"  # (t, m, 2, 2), by the true places
THINNING = "gradient of F33"  # (t, n, 2), 1/mm, by the true places
CURVED = "mean deformation"  # (t, m, 2, 2), of which the stress is the mean over the thickness
VOLUME = "volume ratio"  # (t, m, 3): J, that before it, and by which that one should have been larger
DEFORMATION = "deformation of laws"  # (t, m, 2, 2), of an incompressible sheet
STRESS = "stress"  # P (t, m, 2, 2), MPa
ELASTIC_BESIDE = "elastic deformation gradients of the strip"  # (t, m, 2, 2), in the strip beside the measured region
CURVED_BESIDE = "mean deformation of the strip"  # (t, m, 2, 2)
STRESS_BESIDE = "stress of the strip"  # P (t, m, 2, 2), MPa
LOADS = "loads"  # (t, 2, b), N, as effects correct them


@dataclass(frozen=True)
class Base:
    """A base model of one invariant: its number, that of its functions, and whether in plane strain."""

    invariant: int
    n_functions: int
    plane_strain: bool

    def stress(self, constants: Constants, F: Any) -> Any:
        """P (..., 2, 2), MPa, at F (..., 2, 2); in plane strain at its isochoric part."""
        return base_law(self.invariant, self.n_functions, constants.top, constants.c, F)

    def modulus(self, constants: Constants) -> Any:
        """About its shear modulus at rest, MPa."""
        return (2.0 if self.invariant == 0 else 3.0 * 3.0**0.5) * constants.c[0]
