"""The classical law nearest to a model in uniaxial, equi-biaxial and pure-shear tension, and how far it is.

In: an exported law. Out: parameters by least squares of the nominal stress in the three modes up to the end of the valid range, each weighted
by its largest stress, and the largest error of each mode. Raises `ExportError` where the fit does not
converge.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calibrate.equations.deformation_modes import MODES, stretches_to_gradient
from calibrate.models.classical_laws import CLASSICAL_LAWS, Law
from studies.errors import ExportError
from studies.exporters.material_law import MaterialLaw
from studies.exporters.reference import point_stress

Array = NDArray[np.float64]
POINTS = 40  # a mode
LAWS = {law.name: law for law in CLASSICAL_LAWS}


@dataclass(frozen=True)
class Nearest:
    """parameters (q,) as `Law` takes them. errors: largest stress error of each mode over its largest stress."""

    law: Law
    parameters: Array
    errors: dict[str, float]

    @property
    def worst(self) -> float:
        """Of the modes."""
        return max(self.errors.values())


@lru_cache(maxsize=16)
def nearest(law: MaterialLaw, name: str) -> Nearest:
    """The nearest law of a name in `calibrate.models.classical_laws`."""
    form, modes = LAWS[name], {mode: mode_curve(law, mode) for mode in MODES}
    F = np.concatenate([f for f, _ in modes.values()])
    stress = np.concatenate([s for _, s in modes.values()])
    size = np.concatenate([np.full(len(s), np.abs(s).max()) for _, s in modes.values()])
    modulus = float(modes["uniaxial"][1][0] / (3 * (modes["uniaxial"][0][0, 0, 0] - 1)))
    found = least_squares(
        lambda p: (form.stress(F, p)[:, 0, 0] - stress) / size,
        form.start(modulus, float((F**2).sum((1, 2)).max()) - 2),
        lambda p: (form.stress_and_sensitivity(F, p)[1][:, :, 0, 0] / size).T,
        bounds=(form.lower, np.inf), x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=500,
    )  # fmt: skip
    if not found.success:
        raise ExportError(
            f"{law.name}: no {name} law was found near it ({found.message}); export --to yeoh or --to marlow"
        )
    errors = {
        mode: float(np.abs(form.stress(f, found.x)[:, 0, 0] - s).max() / np.abs(s).max())
        for mode, (f, s) in modes.items()
    }
    return Nearest(form, found.x, errors)


def mode_curve(law: MaterialLaw, mode: str, points: int = POINTS) -> tuple[Array, Array]:
    """F (k, 2, 2) of a mode up to the end of the valid range, without rest, and the model's nominal stress along the pull (k,)."""
    F = stretches_to_gradient(mode, np.linspace(1, law.largest_stretch(mode), points + 1)[1:])
    return F, point_stress(law.stress, F)[:, 0, 0]
