"""Marlow card for Abaqus: the model's uniaxial curve as a table, with what is lost between its points and in the other modes.

A Marlow law is an energy of I1 alone whose slope is that of the uniaxial test, psi_1 = S / (2 (x - x^-2)) at the stretch x of the same I1
(Marlow 2003). Of a model that depends on I2 as well, it keeps the uniaxial curve alone: the header states the error in the other modes.
"""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.equations.deformation_modes import mode_invariants
from calibrate.equations.kinematics import invariants_and_derivatives
from studies.exporters.material_law import MaterialLaw
from studies.exporters.nearest_law import mode_curve
from studies.exporters.target import Volume
from studies.exporters.uniaxial_table import CHECKED, ROWS, UniaxialTable

Array = NDArray[np.float64]


class MarlowCard(UniaxialTable):
    """Engineering stress and strain in uniaxial tension."""

    name = "marlow"
    file_name = "marlow.inp"
    summary = "the uniaxial curve as a table (Abaqus, Marlow), with its error in the other modes"
    comment = "**"

    def body(self, law: MaterialLaw, volume: Volume) -> str:
        stretch, stress = table(law)
        head = self.stated_errors(law)
        rows = [f"{s:.10g}, {x - 1:.10g}" for x, s in zip(stretch, stress, strict=True)]
        keywords = ["*MATERIAL, NAME=EQUIGAP", "*HYPERELASTIC, MARLOW", "*UNIAXIAL TEST DATA", *rows]
        volumetric = [
            "*VOLUMETRIC TEST DATA",
            *(f"{volume.bulk_modulus * (1 - J):.10g}, {J:.10g}" for J in (0.98, 0.99, 1.0)),
        ]
        return "\n".join([*head, *keywords, *volumetric, ""])

    def sheet_stress(self, law: MaterialLaw, F: Array) -> Array:
        values, first = map(np.asarray, invariants_and_derivatives(jnp.asarray(F)))
        return np.asarray(_slope_of_I1(law)(values[:, 0])[:, None, None] * first[:, 0])


def table(law: MaterialLaw) -> tuple[Array, Array]:
    """Stretches and nominal stresses (ROWS + 1,) in uniaxial tension, from rest to the end of the valid range."""
    F, stress = mode_curve(law, "uniaxial", ROWS)
    return np.concatenate([[1.0], F[:, 0, 0]]), np.concatenate([[0.0], stress])


def _slope_of_I1(law: MaterialLaw) -> Callable[[Array], Array]:
    """psi_1 (n,) at I1 (n,), of a table that is linear between its points; next to rest that of its first interval."""
    stretch, stress = table(law)
    between = np.linspace(1, stretch[-1], CHECKED * ROWS)
    known = mode_invariants("uniaxial", between)[:, 0]

    def slope(I1: Array) -> Array:
        x = np.maximum(np.interp(I1, known, between), 1 + 1e-3 * (stretch[1] - 1))
        return np.asarray(np.interp(x, stretch, stress) / (2 * (x - x**-2)))

    return slope
