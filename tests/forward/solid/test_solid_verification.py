"""The solid on irregular hexes: affine states exactly, a universal deformation at the orders of the element."""

import numpy as np
import pytest
from forward_helpers import MATERIALS, energy_derivatives
from scipy.linalg import expm
from solid_helpers import (
    SwollenAndTwisted,
    block,
    displacement_at,
    follow,
    on_rim,
    places,
    pressure_at,
    pressure_jumps,
    problem_on,
    sector,
)

from forward import ArrudaBoyce
from meshes.elements import quad_shape_gradients, quad_shapes

RATE = np.array([[0.25, 0.2, -0.1], [0.1, -0.05, 0.15], [0.05, -0.2, -0.2]])  # trace zero: no change of volume
FACES = {"right": (0, 1), "symmetry_x": (0, -1), "top": (1, 1), "symmetry_y": (1, -1)}
FACES |= {"surface": (2, 1), "symmetry_z": (2, -1)}
UPRIGHT = [0, 1, 7, 6, 2, 4, 8, 3, 5]  # nodes of an upright face in the order of a quad


def affine_state(material, kappa, t=1.0):
    """F, p and nominal stress on an affine path whose volume grows by half the shear modulus over kappa."""
    J = 1 + 0.5 * t * material.shear_modulus / kappa
    F = J ** (1 / 3) * expm(t * RATE)
    C, T, p = F.T @ F, np.linalg.inv(F).T, kappa * (J - 1)
    I1, I2 = np.trace(C), (np.trace(C) ** 2 - np.trace(C @ C)) / 2
    psi1, psi2 = energy_derivatives(material, J ** (-2 / 3) * I1)
    P = 2 * psi1 * J ** (-2 / 3) * (F - I1 / 3 * T)
    P += 2 * psi2 * J ** (-4 / 3) * (I1 * F - F @ C - 2 / 3 * I2 * T)
    return F, p, P + p * J * T


def traction_forces(mesh, P):
    """Nodal forces (n, 3) of a constant nominal stress: int N_a P n dA over the six faces of a block."""
    x, w = np.polynomial.legendre.leggauss(3)
    at, weights = np.array([(a, b) for b in x for a in x]), np.outer(w, w).ravel()
    forces = np.zeros_like(mesh.points)
    for name, (axis, sign) in FACES.items():
        faces = mesh.boundaries[name] if axis == 2 else mesh.boundaries[name][:, UPRIGHT]
        tangents = np.einsum("qnj,mni->mqji", quad_shape_gradients(at), mesh.points[faces])
        areas = np.linalg.norm(np.cross(tangents[:, :, 0], tangents[:, :, 1]), axis=-1) * weights
        np.add.at(forces, faces, (areas @ quad_shapes(at))[..., None] * (sign * P[:, axis]))
    return forces


@pytest.mark.parametrize("material", MATERIALS.values(), ids=MATERIALS)
def test_affine_patch(material):
    """The inner nodes of distorted hexes find the affine state of their rim; its forces are by the textbook."""
    mesh, kappa = block(n=(3, 2), layers=2), 1e4 * material.shear_modulus
    problem = problem_on(mesh, material, kappa)
    u, q = follow(problem, lambda X, t: X @ (affine_state(material, kappa, t)[0] - np.eye(3)).T, 3)
    F, p, P = affine_state(material, kappa)
    exact = mesh.points @ (F - np.eye(3)).T
    np.testing.assert_allclose(u, exact, atol=1e-9 * np.abs(exact).max())
    np.testing.assert_allclose(q[:, 0], p, rtol=1e-9)
    np.testing.assert_allclose(q[:, 1:], 0, atol=1e-9 * p)
    expected = traction_forces(mesh, P)
    np.testing.assert_allclose(problem.nodal_forces(), expected, atol=1e-9 * np.abs(expected).max())
    assert not expected[~on_rim(mesh)].any()


def on_rim_of_sector(X):
    """Nodes of a sector's outer face, sides and ends; not those that are on the inner face alone."""
    R, Theta, Z = np.hypot(X[:, 0], X[:, 1]), np.arctan2(X[:, 1], X[:, 0]), X[:, 2]
    return np.any([np.abs(x - y) < 1e-9 for x, y in ((R, 2), (Theta, 0), (Theta, 1), (Z, 0), (Z, 1))], axis=0)


def universal_errors(n, material):
    """Errors of displacement (L2, H1) and pressure (L2) on n^3 hexes, and rms jump of the pressure between them."""
    mesh, exact = sector(n, seed=n), SwollenAndTwisted(material)
    kappa = 1e7 * material.shear_modulus  # the exact state is incompressible
    problem = problem_on(mesh, material, kappa, on_rim_of_sector(mesh.points), "mumps", tolerance=1e-9)
    u, q = follow(problem, exact.displacement, 3)
    local, points, weights = places(mesh, 4)
    found, gradients = displacement_at(mesh, u, local)
    errors = (
        found - exact.displacement(points),
        np.eye(3) + gradients - exact.deformation_gradient(points),
        pressure_at(mesh, q, points) - exact.pressure(points),
    )
    norms = [np.sqrt((weights * (e**2).reshape(*weights.shape, -1).sum(-1)).sum()) for e in errors]
    return [*norms, np.sqrt((pressure_jumps(mesh, q) ** 2).mean())]


def test_exact_state_is_in_equilibrium():
    """The universal deformation itself: no change of volume, no body force, no traction inside; 1e-7 by differences."""
    exact, X = SwollenAndTwisted(MATERIALS["mooney_rivlin"]), np.array([[1.2, 0.7, 0.4], [0.8, 0.6, 0.9]])

    def stress(X):
        F = exact.deformation_gradient(X)
        B, T = F @ np.swapaxes(F, -1, -2), np.swapaxes(np.linalg.inv(F), -1, -2)
        I1 = np.trace(B, axis1=-2, axis2=-1)[..., None, None]
        psi1, psi2 = energy_derivatives(exact.material, I1)
        S = 2 * psi1 * B + 2 * psi2 * (I1 * B - B @ B)
        mean = exact.pressure(X)[..., None, None] - np.trace(S, axis1=-2, axis2=-1)[..., None, None] / 3
        return (S + mean * np.eye(3)) @ T

    step = 1e-5 * np.eye(3)
    slopes = [(exact.displacement(X + e) - exact.displacement(X - e)) / 2e-5 for e in step]
    np.testing.assert_allclose(exact.deformation_gradient(X), np.eye(3) + np.stack(slopes, axis=-1), atol=1e-8)
    np.testing.assert_allclose(np.linalg.det(exact.deformation_gradient(X)), 1, rtol=1e-12)
    force = sum(((stress(X + e) - stress(X - e)) / 2e-5)[..., i] for i, e in enumerate(step))
    np.testing.assert_allclose(force, 0, atol=1e-7 * np.abs(stress(X)).max())
    inside = np.array([0.6, 0.8, 0.3])
    np.testing.assert_allclose(stress(inside) @ [0.6, 0.8, 0], 0, atol=1e-12)


def rates(sizes, errors):
    """Slope of log(error) over log(size), fitted."""
    return -np.polyfit(np.log(sizes), np.log(errors), 1)[0]


def check_orders(material, sizes):
    errors = np.array([universal_errors(n, material) for n in sizes])
    displacement, gradient, pressure, jump = rates(sizes, errors)
    assert displacement >= 2.8
    assert gradient >= 1.9
    assert pressure >= 1.9
    assert jump >= 1.2


def test_orders_of_convergence():
    """On hexes whose edges stay skewed under refinement; the jumps show that no checkerboard survives."""
    check_orders(ArrudaBoyce(), (4, 6))


@pytest.mark.slow
def test_orders_of_convergence_with_both_invariants():
    check_orders(MATERIALS["mooney_rivlin"], (4, 6, 9))
