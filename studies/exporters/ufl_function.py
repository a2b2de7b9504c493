"""UFL: the energy as an expression for DOLFINx, without this package."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from studies.exporters.certificate import Errors, errors_of_derivatives
from studies.exporters.energy_terms import NetworkTerm
from studies.exporters.material_law import MaterialLaw
from studies.exporters.python_function import namespace
from studies.exporters.target import Target, Volume, render

Array = NDArray[np.float64]
STAND_IN = SimpleNamespace(as_ufl=jnp.asarray, conditional=jnp.where, exp=jnp.exp, ln=jnp.log, sqrt=jnp.sqrt, gt=jnp.greater,
                           lt=jnp.less, max_value=jnp.maximum)  # fmt: skip


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

        def point(x: Any) -> Any:
            return energy(x[0], x[1])

        def derivatives(I1: Array, I2: Array) -> Array:
            x = jnp.stack([I1, I2], axis=1)
            W, slopes, curvature = (jax.vmap(of)(x) for of in (point, jax.grad(point), jax.hessian(point)))
            return np.stack([W, *slopes.T, curvature[:, 0, 0], curvature[:, 0, 1], curvature[:, 1, 1]])

        return errors_of_derivatives(law, derivatives, "operators of UFL replaced by those of JAX")
