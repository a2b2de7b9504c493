"""LS-DYNA *MAT_SIMPLIFIED_RUBBER/FOAM (181): the model's uniaxial curve in tension and compression, with what it makes of the other modes.

That law is an energy separable in the principal stretches, found from the uniaxial nominal stress P0 (Kolling, Du Bois, Benson and Feng
2007, Computational Mechanics 40):

    f(x) = sum over k of s(x^((-1/2)^k)),   s(x) = x P0(x),   sigma_i - sigma_j = f(x_i) - f(x_j)

Ogden's laws, Mooney-Rivlin among them, are separable and carried exactly; of another law the uniaxial curve alone is kept.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrate.equations.deformation_modes import stretches_to_gradient
from studies.exporters.material_law import MaterialLaw
from studies.exporters.nearest_law import mode_curve
from studies.exporters.reference import point_stress
from studies.exporters.target import Volume
from studies.exporters.uniaxial_table import ROWS, UniaxialTable

Array = NDArray[np.float64]
TERMS = 60  # of the series
DENSITY = 1e-9  # t/mm^3


class Mat181Card(UniaxialTable):
    """Engineering stress and strain, from compression to tension."""

    name = "mat181"
    file_name = "mat181.k"
    summary = "the uniaxial curve as a table (LS-DYNA, *MAT_181), with its error in the other modes"
    comment = "$"

    def body(self, law: MaterialLaw, volume: Volume) -> str:
        stretch, stress = table(law)
        head = [
            *self.stated_errors(law),
            "$ Units: N, mm, s, t. RO is no result: 1e-9 t/mm^3 (1000 kg/m^3), put yours. Rates, unloading and damage: not in this card.",
            "$ SGL = SW = ST = 1: the curve is engineering stress (MPa) against engineering strain.",
        ]
        fields = ["*MAT_SIMPLIFIED_RUBBER/FOAM", _row("MID", "RO", "KM", "MU", "G", "SIGF", "REF", "PRTEN")]
        fields += [_row(1, DENSITY, volume.bulk_modulus, 0.1, 0.0, 0.0, 0.0, 0.0)]
        fields += [_row("SGL", "SW", "ST", "LC/TBID", "TENSION", "RTYPE", "AVGOPT", "PR/BETA")]
        fields += [_row(1.0, 1.0, 1.0, 1, 1.0, 0.0, 0.0, 0.0)]
        fields += ["*DEFINE_CURVE", _row("LCID", "SIDR", "SFA", "SFO", "OFFA", "OFFO", "DATTYP"), _row(1)]
        rows = [f"{x - 1:20.10g}{s:20.10g}" for x, s in zip(stretch, stress, strict=True)]
        return "\n".join([*head, *fields, *rows, "*END", ""])

    def sheet_stress(self, law: MaterialLaw, F: Array) -> Array:
        stretch, stress = table(law)

        def f(x: Array) -> Array:
            powers = [x ** ((-0.5) ** k) for k in range(TERMS)]
            return np.asarray(sum(y * np.interp(y, stretch, stress) for y in powers))

        left, x, right = np.linalg.svd(F)
        normal = f(1 / x.prod(axis=-1))
        principal = (f(x) - normal[:, None]) / x
        return np.asarray((left * principal[:, None, :]) @ right)


def table(law: MaterialLaw) -> tuple[Array, Array]:
    """Stretches and nominal stresses (2 ROWS + 1,) of uniaxial loading, from the compression that has the invariants of the largest
    equi-biaxial tension to the largest tension."""
    lowest = law.largest_stretch("equibiaxial") ** -2
    pressed = np.linspace(lowest, 1, ROWS + 1)[:-1]
    F, tension = mode_curve(law, "uniaxial", ROWS)
    compression = point_stress(law.stress, stretches_to_gradient("uniaxial", pressed))[:, 0, 0]
    return np.concatenate([pressed, [1.0], F[:, 0, 0]]), np.concatenate([compression, [0.0], tension])


def _row(*values: str | float) -> str:
    """Fields of ten characters; names as a comment line."""
    if isinstance(values[0], str):
        return "$" + "".join(f"{v:>10}" for v in values)[1:]
    return "".join(f"{v:>10d}" if isinstance(v, int) else f"{v:>10.4g}" for v in values)
