"""The plane-strain boundary value problem in DOLFINx: as `forward.sheet.plane_stress_problem`, of a compressible body held at its faces.

With F33 = 1, J = det F and C = diag(C2, 1): I1 = tr C2 + 1, I2 = tr C2 + J^2, and the stored energy is
h int psi(J^(-2/3) I1, J^(-4/3) I2) + kappa (J - 1)^2 / 2 dA. Biquadratic quads without a pressure lock where the bulk modulus
is very large.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from forward._dolfinx import QUADRATURE_DEGREE, dolfinx, ufl
from forward.errors import MaterialError
from forward.materials import Material
from forward.sheet.plane_stress_problem import PlaneStressProblem

LARGEST = 1000.0  # bulk modulus over shear modulus


class PlaneStrainProblem(PlaneStressProblem):
    """Displacement u of a body in plane strain. bulk_modulus: MPa; other arguments as of `PlaneStressProblem`."""

    def __init__(self, *arguments: Any, bulk_modulus: float, **keywords: Any) -> None:
        self.bulk_modulus = bulk_modulus
        super().__init__(*arguments, **keywords)

    def _forms(self, material: Material, thickness: float) -> tuple[Any, Any, Any]:
        parameters = dolfinx.fem.Constant(self.domain, np.array(material.parameters))
        h, kappa = (dolfinx.fem.Constant(self.domain, float(x)) for x in (thickness, self.bulk_modulus))
        F = ufl.Identity(2) + ufl.grad(self.u)
        J, trace = ufl.det(F), ufl.tr(F.T * F)
        isochoric = J ** (-2 / 3) * (trace + 1), J ** (-4 / 3) * (trace + J**2)
        dx = ufl.dx(domain=self.domain, metadata={"quadrature_degree": QUADRATURE_DEGREE})
        energy = h * (material.energy(*isochoric, parameters) + kappa / 2 * (J - 1) ** 2) * dx
        return energy, ufl.derivative(energy, self.u, ufl.TestFunction(self.V)), None


def check_bulk_modulus(bulk_modulus: float, shear_modulus: float) -> None:
    """Raises `MaterialError` for what is no bulk modulus, or one at which these elements lock."""
    if not 0 < bulk_modulus <= LARGEST * shear_modulus:
        raise MaterialError(
            f"bulk modulus {bulk_modulus:g} MPa: plane strain needs one above 0 and at most {LARGEST:g} shear moduli "
            f"({LARGEST * shear_modulus:g} MPa), as a nearly incompressible body locks these elements"
        )
