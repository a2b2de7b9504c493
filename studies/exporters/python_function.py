"""Python: the energy and its derivatives as functions that need numpy alone, for felupe, JAX and programs of one's own."""

from __future__ import annotations

from typing import Any

from studies.exporters.certificate import Errors, errors_of_derivatives
from studies.exporters.energy_terms import NetworkTerm
from studies.exporters.material_law import MaterialLaw
from studies.exporters.target import Target, Volume, render


class PythonFunction(Target):
    """energy, derivatives, plane_stress (P and dP/dF of a sheet), solid_energy."""

    name = "python"
    file_name = "law.py"
    summary = "Python functions that need numpy alone (or jax.numpy): energy, stress, tangent"
    comment = "#"

    def body(self, law: MaterialLaw, volume: Volume) -> str:
        hidden = [
            [(W.tolist(), b.tolist()) for W, b in term.hidden] if isinstance(term, NetworkTerm) else None
            for term in law.terms
        ]
        return render("exported_law.py.txt", law=law, volume=volume, hidden=hidden)

    def errors(self, law: MaterialLaw, volume: Volume, body: str) -> Errors | None:
        return errors_of_derivatives(law, namespace(body)["derivatives"], "run in Python")


def namespace(body: str, **given: Any) -> dict[str, Any]:
    """What the generated file defines; given: names that it finds."""
    found: dict[str, Any] = {"__name__": "law", **given}
    exec(compile(body, "law.py", "exec"), found)
    return found
