"""UFL: the energy as an expression for DOLFINx, without this package."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from studies.exporters.certificate import Errors, errors_of_derivatives
from studies.exporters.dual_numbers import Dual, where
from studies.exporters.energy_terms import NetworkTerm
from studies.exporters.material_law import MaterialLaw
from studies.exporters.python_function import namespace
from studies.exporters.target import Target, Volume, render

Array = NDArray[np.float64]
STAND_IN = SimpleNamespace(
    as_ufl=Dual.of, conditional=where, exp=Dual.exp, ln=Dual.log, sqrt=lambda x: x**0.5, gt=lambda a, b: (a - b).value > 0,
    lt=lambda a, b: (a - b).value < 0, max_value=lambda a, b: where((a - b).value > 0, a, Dual.of(b)),
)  # fmt: skip


class UflFunction(Target):
    """plane_stress_energy(F), solid_energy(F)."""

    name = "ufl"
    file_name = "law_ufl.py"
    summary = "UFL functions for DOLFINx: energy of a sheet and of a solid"
    comment = "#"

    def body(self, law: MaterialLaw, volume: Volume) -> str:
        hidden = [
            [(W.tolist(), b.tolist()) for W, b in term.hidden] if isinstance(term, NetworkTerm) else None
            for term in law.terms
        ]
        return render("exported_ufl.py.txt", law=law, volume=volume, hidden=hidden)

    def errors(self, law: MaterialLaw, volume: Volume, body: str) -> Errors | None:
        energy = namespace(body.replace("import ufl\n", ""), ufl=STAND_IN)["energy"]

        def derivatives(I1: Array, I2: Array) -> Array:
            return energy(Dual.variable(I1, 0), Dual.variable(I2, 1)).rows

        return errors_of_derivatives(law, derivatives, "operators of UFL replaced by dual numbers")
