"""Virtual fields of observations: their derivatives against solutions (Taylor order), and the forces of a stress."""

from __future__ import annotations

import numpy as np
import pytest
from orders import taylor_rates

from forward import MooneyRivlin, NeoHooke
from forward.errors import ConvergenceError
from forward.sheet.adjoint import AdjointSheet, force_operator, gradients
from meshes import PlateWithHole, quads

MESH = quads(PlateWithHole(), size_factor=4.0)
N = len(MESH.points)
SIDES = {name: MESH.boundary_nodes(name) for name in ("left", "right")}
PARAMETERS = np.array([0.1, 0.03])
CHANGE = np.array([0.02, 0.01])


def moved_sides(amplitude: float) -> tuple[np.ndarray, np.ndarray]:
    """The sides held, pulled apart and bent by a wave of an amplitude, mm."""
    held, values = np.zeros((N, 2), bool), np.zeros((N, 2))
    for sign, nodes in zip((-1, 1), SIDES.values(), strict=True):
        y = MESH.points[nodes, 1]
        held[nodes] = True
        values[nodes, 0] = sign * (20 + amplitude * np.sin(y / 5))
        values[nodes, 1] = amplitude * np.cos(y / 7)
    return held, values


def sheet(parameters: np.ndarray = PARAMETERS, amplitude: float = 0.0, thickness: float = 2.0) -> AdjointSheet:
    return AdjointSheet(MESH, MooneyRivlin(*parameters), thickness, *moved_sides(amplitude))


def solved(problem: AdjointSheet, start: np.ndarray | None = None) -> np.ndarray:
    u = np.zeros((N, 2)) if start is None else start
    for factor in (0.5, 1.0) if start is None else (1.0,):
        u = problem.equilibrium(factor, u)
    return u


@pytest.fixture(scope="module")
def base():
    """The sheet in equilibrium, weights of two observations of the displacements, and the sides whose force along x is the third."""
    problem = sheet()
    u = solved(problem)
    weights = np.zeros((3, N, 2))
    weights[:2] = np.random.default_rng(0).normal(size=(2, N, 2)) / N
    on_held = np.zeros((3, N, 2))
    on_held[2, SIDES["right"], 0] = 1.0
    fields = problem.virtual_fields(weights, on_held)
    return problem, u, weights, on_held, fields


def observed(problem: AdjointSheet, u: np.ndarray, weights: np.ndarray, on_held: np.ndarray) -> np.ndarray:
    return np.einsum("rni,ni->r", weights, u) + np.einsum("rni,ni->r", on_held, problem.nodal_forces())


def test_a_change_of_the_law(base):
    problem, u, weights, on_held, fields = base
    F = gradients(MESH, u)
    change = np.zeros((N, 2))
    for k, own in enumerate(np.eye(2)):
        # the energy is linear in its parameters
        other = AdjointSheet(MESH, MooneyRivlin(*(PARAMETERS + own)), 2.0, *moved_sides(0.0))
        other.unknowns = (u,)
        problem.unknowns = (u,)
        change += CHANGE[k] * (other.nodal_forces() - problem.nodal_forces())
    slope = np.einsum("rni,ni->r", fields.values, change)
    before = observed(problem, u, weights, on_held)

    def remainder(step: float) -> float:
        other = sheet(PARAMETERS + step * CHANGE)
        found = observed(other, solved(other, u), weights, on_held)
        return float(np.linalg.norm((found - before - step * slope) / np.abs(before)))

    assert F.shape == (9 * len(MESH.cells), 2, 2)
    assert taylor_rates(remainder, 0)[-3:] == pytest.approx(2.0, abs=0.1)


def test_a_change_of_the_motion_of_the_sides(base):
    problem, u, weights, on_held, fields = base
    problem.unknowns = (u,)
    before = observed(problem, u, weights, on_held)
    held, values = moved_sides(1.0)
    change = values - moved_sides(0.0)[1]
    slope = np.einsum("rni,ni->r", fields.held + weights * held, change)

    def remainder(step: float) -> float:
        other = sheet(amplitude=step)
        found = observed(other, solved(other, u), weights, on_held)
        return float(np.linalg.norm((found - before - step * slope) / np.abs(before)))

    assert taylor_rates(remainder, 2)[-3:] == pytest.approx(2.0, abs=0.1)


def test_forces_of_a_stress_are_those_of_the_energy(base):
    problem, u = base[:2]
    problem.unknowns = (u,)
    F = gradients(MESH, u)
    J = np.linalg.det(F)
    inverse = np.linalg.inv(F).swapaxes(1, 2)
    neo = NeoHooke(0.4)
    other = AdjointSheet(MESH, neo, 2.0, *moved_sides(0.0))
    other.unknowns = (u,)
    P = neo.mu * (F - inverse / J[:, None, None] ** 2)  # plane stress: F33 = 1 / J
    forces = 2.0 * (force_operator(MESH) @ P.ravel()).reshape(-1, 2)
    np.testing.assert_allclose(forces, other.nodal_forces(), atol=1e-11)


def test_no_equilibrium_is_named():
    held, values = moved_sides(0.0)
    values[SIDES["right"], 0] = -500.0
    with pytest.raises(ConvergenceError, match="no equilibrium at 1 of the load"):
        AdjointSheet(MESH, NeoHooke(0.4), 1.0, held, values).equilibrium(1.0, np.zeros((N, 2)))
