"""The potential of the perturbed Lagrangian in UFL, for the stored energy and for checks of the compiled hexes.

The pressure of a hex is q0 + q . (X - Xc), so it is a vector of four constants in each hex.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from forward._dolfinx import QUADRATURE_DEGREE, dolfinx, ufl
from forward.materials import Material
from forward.solid.element import CENTRE, isochoric_invariants


def pressure_basis(domain: Any, centres: Any) -> Any:
    """UFL vector [1, X - Xc] (4,); centres: function of the hexes' centre nodes."""
    X = ufl.SpatialCoordinate(domain) - centres
    return ufl.as_vector([1, X[0], X[1], X[2]])


def centre_function(domain: Any, to_local: Any) -> Any:
    """Function (3,), constant in each hex: its centre node, mm; to_local: place of the mesh's nodes in DOLFINx's hex."""
    centres = dolfinx.fem.Function(dolfinx.fem.functionspace(domain, ("DG", 0, (3,))))
    nodes = np.asarray(domain.geometry.dofmaps[0])[:, to_local[CENTRE]]
    cells = centres.function_space.dofmap.list[:, 0]
    centres.x.array.reshape(-1, 3)[cells] = domain.geometry.x[nodes]
    return centres


def potential(u: Any, p: Any, material: Material, parameters: Any, kappa: Any, domain: Any) -> Any:
    """UFL form of the stored energy, N mm, for displacement u and pressure p."""
    F = ufl.Identity(3) + ufl.grad(u)
    psi = material.energy(*isochoric_invariants(F), parameters)
    dx = ufl.dx(domain=domain, metadata={"quadrature_degree": QUADRATURE_DEGREE})
    return (psi + p * (ufl.det(F) - 1) - p**2 / (2 * kappa)) * dx
