"""Viscous branches at the Gauss points of a sheet: stress and tangent as fields that forms can use, and the state that they keep.

The law of a point is `multiplicative_viscosity`. F of a sheet and a duration in; P of all branches, MPa, and dP/dF out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forward._dolfinx import ufl
from forward.sheet.multiplicative_viscosity import MaxwellBranch, flowed, step
from forward.sheet.quadrature_fields import (
    evaluate,
    get_values,
    quadrature_expression,
    quadrature_function,
    set_values,
)

Array = NDArray[np.float64]


class OverstressFields:
    """Branches of a sheet with the deformation gradient F (2, 2) in UFL; `new_variable` makes a state variable (name, shape, start)."""

    def __init__(
        self, branches: Sequence[MaxwellBranch], F: Any, domain: Any, new_variable: Callable[..., Any]
    ) -> None:
        self.branches, self.domain, self.duration = branches, domain, 0.0
        self._F = quadrature_expression(F, domain)
        self._past = [new_variable(f"branch_{i}", (2, 2), np.eye(2)) for i in range(len(branches))]
        self._before = new_variable("branches_F", (2, 2), np.eye(2))
        self._half: tuple[list[Array], list[Array]] | None = None
        self.stress = quadrature_function(domain, (2, 2))
        self._tangent = quadrature_function(domain, (4, 4))

    def change(self, slope: Any) -> Any:
        """Change (2, 2) of the stress in UFL with that of F, `slope` (2, 2)."""
        flat = ufl.as_vector([slope[i, j] for i in range(2) for j in range(2)])
        found = ufl.dot(self._tangent, flat)
        return ufl.as_matrix([[found[0], found[1]], [found[2], found[3]]])

    def update(self) -> list[Array]:
        """Stress and tangent at the present F; the states (cells, 9, 2, 2) of the branches that would be committed."""
        F = self._deformation()
        ends = [step(b, F, half, self.duration) for b, half in zip(self.branches, self._halves(), strict=True)]
        set_values(self.stress, np.sum([end.stress for end in ends], axis=0))
        set_values(self._tangent, np.sum([end.tangent for end in ends], axis=0).reshape(*F.shape[:2], 4, 4))
        return [end.past for end in ends]

    def _halves(self) -> list[Array]:
        """States of the branches after half of the step at the F before it: the same in every iteration of a step."""
        start = [np.array(self.duration), get_values(self._before), *(get_values(past) for past in self._past)]
        if self._half is None or not all(map(np.array_equal, start, self._half[0])):
            before, pasts = start[1], start[2:]
            found = [flowed(b, before, a, self.duration / 2) for b, a in zip(self.branches, pasts, strict=True)]
            self._half = [np.array(one) for one in start], found
        return self._half[1]

    def commit(self) -> None:
        """Take the present state as the past of the next step."""
        for variable, state in zip(self._past, self.update(), strict=True):
            set_values(variable, state)
        set_values(self._before, self._deformation())

    def _deformation(self) -> Array:
        values = evaluate(self._F, self.domain)
        return values.reshape(*values.shape[:2], 2, 2)
