"""Quadratic triangles: quadrature, evaluation, forces and state variables, against closed forms and quads."""

from __future__ import annotations

from math import factorial

import numpy as np
import pytest
from forward_helpers import annulus, in_triangles, nominal_stresses

from forward import Loading, NeoHooke
from forward.interpolation import gauss_points, gauss_rule, gradients_at, locate, values_at
from forward.sheet.additions import Mullins
from forward.sheet.adjoint import AdjointSheet, force_operator, gradients
from forward.sheet.inelastic import solve_history
from forward.sheet.plane_stress import solve
from forward.sheet.thin_sheet import Prony, Sheet
from forward.solution import SurfaceSolution
from meshes import PlateWithHole, Strip, quads

RING = in_triangles(annulus(6))


@pytest.mark.parametrize(("a", "b"), [(a, b) for a in range(6) for b in range(6 - a)])
def test_the_rule_is_exact_for_the_fifth_degree(a: int, b: int) -> None:
    places, weights = gauss_rule(RING)
    exact = factorial(a) * factorial(b) / factorial(a + b + 2)
    assert (weights * places[:, 0] ** a * places[:, 1] ** b).sum() == pytest.approx(exact, rel=1e-12)


def test_area_values_and_gradients_of_a_quadratic_field() -> None:
    """On straight triangles a quadratic field is exact; the area of curved ones is that of the mesh."""
    assert gauss_points(RING)[2].sum() == pytest.approx(RING.area(), rel=1e-12)
    assert RING.area() == pytest.approx(0.25 * np.pi * (2**2 - 1**2), rel=1e-5)
    mesh = in_triangles(quads(Strip(half_length=3.0, half_width=1.0, far_size=0.5), quarter=True))
    at = np.random.default_rng(0).uniform([0, 0], [3, 1], (40, 2))
    x, y = mesh.points.T
    field = np.column_stack([x**2 - x * y, 0.5 * y**2 + x])
    places = locate(mesh, at)
    assert not places.excess.any()
    x, y = at.T
    np.testing.assert_allclose(
        values_at(mesh, places, field), np.column_stack([x**2 - x * y, 0.5 * y**2 + x]), atol=1e-12
    )
    slopes = np.stack([np.column_stack([2 * x - y, -x]), np.column_stack([np.ones_like(x), y])], axis=1)
    np.testing.assert_allclose(gradients_at(mesh, places, field), slopes, atol=1e-11)


def test_a_strip_is_that_of_the_closed_form() -> None:
    strip = in_triangles(quads(Strip(half_length=30.0, half_width=10.0, far_size=8.0), quarter=True))
    material = NeoHooke(0.3)
    solution = solve(strip, material, Loading({"right": (45.0, None)}), 3, 2.0)
    for u, force, t in zip(solution.displacements, solution.reactions["right"], solution.time, strict=True):
        a = 1 + 1.5 * t
        assert force[0] == pytest.approx(nominal_stresses(material, a, a**-0.5)[0] * 20.0, rel=1e-8)
        np.testing.assert_allclose(u, solution.points * [a - 1, a**-0.5 - 1], atol=1e-8)


def test_a_sheet_with_history_agrees_with_quads() -> None:
    """Relaxation and softening keep state variables in the cells: both meshes of a plate with a hole agree within their errors."""
    mesh = quads(PlateWithHole(), quarter=True, size_factor=1.5)
    sheet = Sheet(NeoHooke(0.4), 1.0, additions=(Mullins(0.3),), prony=(Prony(0.8, 0.5),))
    loading = Loading({"right": (12.0, 0.0)})
    forces = [
        solve_history(one, sheet, loading, [0.5, 1.0, 0.6], [0.5, 1.0, 1.4], substeps=2).reactions["right"][:, 0]
        for one in (mesh, in_triangles(mesh))
    ]
    np.testing.assert_allclose(forces[1], forces[0], rtol=5e-4)


def test_forces_of_a_stress_are_those_of_the_energy() -> None:
    material, held = NeoHooke(0.4), np.zeros((len(RING.points), 2), bool)
    held[RING.boundary_nodes("rim")] = True
    u = 0.1 * np.column_stack([RING.points[:, 0] * RING.points[:, 1], RING.points[:, 1] ** 2])
    problem = AdjointSheet(RING, material, 2.0, held, np.zeros_like(u))
    problem.unknowns = (u,)
    F = gradients(RING, u)
    P = material.mu * (
        F - np.linalg.inv(F).swapaxes(1, 2) / np.linalg.det(F)[:, None, None] ** 2
    )  # plane stress: F33 = 1 / J
    found = 2.0 * (force_operator(RING) @ P.ravel()).reshape(-1, 2)
    np.testing.assert_allclose(found, problem.nodal_forces(), atol=1e-11)


def test_a_file_keeps_the_cells(tmp_path) -> None:
    zero = np.zeros(1)
    solution = SurfaceSolution(RING, 0.1 * RING.points[None], {}, zero, zero, zero.astype(int), 1.0)
    solution.save(tmp_path / "ring.npz")
    copy = SurfaceSolution.load(tmp_path / "ring.npz")
    assert copy.mesh.cell_type == "triangle6"
    np.testing.assert_array_equal(copy.mesh.cells, RING.cells)
