"""Invariants, stresses and gradients against closed forms of homogeneous states."""

import jax.numpy as jnp
import numpy as np
import pytest
from synthetic import ArrudaBoyce, MooneyRivlin, plate, random_gradients, rotation

from calibrate import errors
from calibrate.equations import kinematics
from calibrate.equations.deformation_modes import stretches_to_gradient

STRETCH = np.linspace(0.6, 3.5, 13)
# I1, I2 and the nominal Mooney-Rivlin stress along the pull, e.g. Holzapfel 2000, section 6.5
CLOSED_FORMS = {
    "uniaxial": (
        lambda s: (s**2 + 2 / s, s**-2 + 2 * s),
        lambda s, c10, c01: 2 * (s - s**-2) * (c10 + c01 / s),
    ),
    "equibiaxial": (
        lambda s: (2 * s**2 + s**-4, 2 * s**-2 + s**4),
        lambda s, c10, c01: 2 * (s - s**-5) * (c10 + c01 * s**2),
    ),
    "pure_shear": (
        lambda s: (s**2 + s**-2 + 1, s**2 + s**-2 + 1),
        lambda s, c10, c01: 2 * (s - s**-3) * (c10 + c01),
    ),
}


@pytest.mark.parametrize("mode", CLOSED_FORMS)
def test_invariants_of_homogeneous_states(mode):
    F = stretches_to_gradient(mode, STRETCH)
    values, _ = kinematics.invariants_and_derivatives(jnp.asarray(F))
    expected = np.stack(CLOSED_FORMS[mode][0](STRETCH), axis=1)
    np.testing.assert_allclose(values, expected, rtol=1e-13)


@pytest.mark.parametrize("mode", CLOSED_FORMS)
def test_stress_of_homogeneous_states(mode):
    material = MooneyRivlin(0.12, 0.04)
    F = stretches_to_gradient(mode, STRETCH)
    P = np.asarray(kinematics.nominal_stress(material, jnp.asarray(F)))
    expected = CLOSED_FORMS[mode][1](STRETCH, material.c10, material.c01)
    np.testing.assert_allclose(P[:, 0, 0], expected, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(P[:, [0, 1], [1, 0]], 0.0, atol=1e-14)
    if mode == "uniaxial":
        np.testing.assert_allclose(P[:, 1, 1], 0.0, atol=1e-13)


def test_stress_is_the_derivative_of_the_energy():
    F, material, h = random_gradients(20), ArrudaBoyce(), 1e-6
    P = np.asarray(kinematics.nominal_stress(material, jnp.asarray(F)))
    for i, j in np.ndindex(2, 2):
        step = np.zeros((2, 2))
        step[i, j] = h
        energies = [[float(material(kinematics.invariants(jnp.asarray(f)))) for f in F + s * step] for s in (1, -1)]
        np.testing.assert_allclose(P[:, i, j], np.subtract(*energies) / (2 * h), rtol=1e-6, atol=1e-8)


def test_hessian_of_the_invariants():
    F, h = random_gradients(10), 1e-6
    hessian = np.asarray(kinematics.invariant_hessians(jnp.asarray(F)))
    for i, j in np.ndindex(2, 2):
        step = np.zeros((2, 2))
        step[i, j] = h
        plus, minus = (np.asarray(kinematics.invariants_and_derivatives(jnp.asarray(F + s * step))[1]) for s in (1, -1))
        expected = (plus - minus) / (2 * h)
        scale = np.abs(expected).max()
        np.testing.assert_allclose(hessian[..., i, j], expected, rtol=1e-6, atol=1e-7 * scale)


def test_invariants_ignore_rotations():
    F = random_gradients(30)
    Q, R = rotation(0.4), rotation(-1.9)
    before, _ = kinematics.invariants_and_derivatives(jnp.asarray(F))
    after, _ = kinematics.invariants_and_derivatives(jnp.asarray(Q @ F @ R))
    np.testing.assert_allclose(after, before, rtol=1e-11)


def test_gradient_operator_is_exact_for_linear_fields():
    points, triangles, _ = plate(16, 4)
    operator = kinematics.gradient_operator(points, triangles)
    H = np.array([[[0.3, -0.1], [0.2, 0.05]], [[0.0, 0.4], [-0.2, 0.1]]])
    u = np.einsum("tij,nj->tni", H, points) + np.array([1.0, -2.0])
    F = kinematics.deformation_gradients(operator, u)
    assert F.shape == (2, len(triangles), 2, 2)
    np.testing.assert_allclose(F, np.broadcast_to((np.eye(2) + H)[:, None], F.shape), atol=1e-12)


def test_shape_functions_are_a_partition_of_unity():
    points, triangles, _ = plate(16, 4)
    gradients, areas = kinematics.shape_gradients(points, triangles)
    np.testing.assert_allclose(gradients.sum(axis=1), 0.0, atol=1e-13)
    hole = 0.5 * 16 * 8.0**2 * np.sin(2 * np.pi / 16)
    np.testing.assert_allclose(areas.sum(), polygon_area(points[-16:]) - hole, rtol=1e-12)


def polygon_area(corners):
    """Area enclosed by corners (k, 2) in order."""
    x, y = corners.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def test_unknown_modes_are_named():
    with pytest.raises(errors.ConfigError, match="'biaxial' .*uniaxial, equibiaxial, pure_shear"):
        stretches_to_gradient("biaxial", STRETCH)
