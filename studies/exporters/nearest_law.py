"""The classical law nearest to a model in uniaxial, equi-biaxial and pure-shear tension, and how far it is.

In: an exported law. Out: parameters by least squares of the nominal stress in the modes that the calibration has seen, as far as it has seen each, weighted
by its largest stress, and the largest error of each. Raises `ExportError` where the fit does not
converge.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calibrate.equations.deformation_modes import stretches_to_gradient
from calibrate.models.classical_laws import CLASSICAL_LAWS, Law
from studies.errors import ExportError
from studies.exporters.material_law import MaterialLaw
from studies.exporters.reference import point_stress

Array = NDArray[np.float64]
POINTS = 40  # a mode
LEAST = 1e-3  # strain in a mode that counts as seen
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
    form, modes = LAWS[name], seen_curves(law)
    F = np.concatenate([f for f, _ in modes.values()])
    stress = np.concatenate([s for _, s in modes.values()])
    size = np.concatenate([np.full(len(s), np.abs(s).max()) for _, s in modes.values()])
    first, tension = mode_curve(law, "uniaxial")
    modulus = float(tension[0] / (3 * (first[0, 0, 0] - 1)))
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


def seen_curves(law: MaterialLaw, points: int = POINTS) -> dict[str, tuple[Array, Array]]:
    """`mode_curve` of every mode as far as the calibration has seen it; of those alone that it has seen at all, of all where it has seen none."""
    ends = {mode: end for mode, end in law.valid.items() if end > 1 + LEAST} or law.stretches
    return {mode: mode_curve(law, mode, points, end) for mode, end in ends.items()}


def mode_curve(law: MaterialLaw, mode: str, points: int = POINTS, end: float | None = None) -> tuple[Array, Array]:
    """F (k, 2, 2) of a mode up to a stretch, without rest, and the model's nominal stress along the pull (k,). end: None for that of the range of the invariants."""
    F = stretches_to_gradient(mode, np.linspace(1, end or law.largest_stretch(mode), points + 1)[1:])
    return F, point_stress(law.stress, F)[:, 0, 0]
