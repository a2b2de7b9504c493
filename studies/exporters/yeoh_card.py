"""Material card of the nearest Yeoh law, for Abaqus and CalculiX, with its stress error in every mode of the calibrated range."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.equations.deformation_modes import MODES, TITLES, stretches_to_gradient
from calibrate.equations.kinematics import invariants_and_derivatives
from studies.exporters.certificate import Errors, errors_of_derivatives
from studies.exporters.material_law import MaterialLaw
from studies.exporters.reference import point_stress
from studies.exporters.target import Target, Volume

Array = NDArray[np.float64]
POINTS = 40  # a mode
POWERS = np.array([1, 2, 3])


class YeohCard(Target):
    """C10, C20, C30 by least squares of the nominal stress in the three homogeneous modes, each weighted by its largest stress."""

    name = "yeoh"
    file_name = "yeoh.inp"
    summary = "material card (Abaqus, CalculiX): the nearest Yeoh law, with its error"
    comment = "**"

    def body(self, law: MaterialLaw, volume: Volume) -> str:
        c = coefficients(law)
        errors = [
            f"** stress error in {TITLES[mode]}, over its largest stress: {share:.2e}"
            for mode, share in mode_errors(law, c).items()
        ]
        values = ", ".join(f"{x:.12g}" for x in (*c, 2 / volume.bulk_modulus, 0.0, 0.0))
        return "\n".join([*errors, "*MATERIAL, NAME=EQUIGAP", "*HYPERELASTIC, YEOH", values, ""])

    def errors(self, law: MaterialLaw, volume: Volume, body: str) -> Errors | None:
        c = np.array([float(x) for x in body.splitlines()[-1].split(",")[:3]])

        def derivatives(I1: Array, I2: Array) -> Array:
            x, zero = (I1 - 3)[:, None], np.zeros_like(I1)
            second = np.array([0.0, 2.0, 6.0]) * np.concatenate([0 * x, 1 + 0 * x, x], axis=1)
            return np.stack([x**POWERS @ c, POWERS * x ** (POWERS - 1) @ c, zero, second @ c, zero, zero])

        return errors_of_derivatives(law, derivatives, "of the Yeoh law itself")


def coefficients(law: MaterialLaw) -> Array:
    """C10, C20, C30 (3,), in the unit of the law."""
    rows = [_mode(law, mode) for mode in MODES]
    A = np.concatenate([columns / np.abs(stress).max() for columns, stress in rows])
    b = np.concatenate([stress / np.abs(stress).max() for _, stress in rows])
    return np.asarray(np.linalg.lstsq(A, b, rcond=None)[0])


def mode_errors(law: MaterialLaw, c: Array) -> dict[str, float]:
    """Largest stress error of each mode over its largest stress."""
    found = {mode: _mode(law, mode) for mode in MODES}
    return {m: float(np.abs(columns @ c - s).max() / np.abs(s).max()) for m, (columns, s) in found.items()}


def _mode(law: MaterialLaw, mode: str) -> tuple[Array, Array]:
    """Nominal stress along the pull of unit coefficients (k, 3), and of the model (k,)."""
    F = stretches_to_gradient(mode, np.linspace(1, law.largest_stretch(mode), POINTS + 1)[1:])
    values, first = map(np.asarray, invariants_and_derivatives(jnp.asarray(F)))
    x = values[:, :1] - 3
    return POWERS * x ** (POWERS - 1) * first[:, 0, 0, :1], point_stress(law.stress, F)[:, 0, 0]
