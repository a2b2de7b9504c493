"""The spline bases: what they reproduce, their derivatives, and the strain measures they are written in."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import BSpline
from synthetic import ArrudaBoyce, HartmannNeff, derivatives, random_gradients

from calibrate import errors
from calibrate.equations import basis as bases
from calibrate.equations import kinematics
from calibrate.equations.deformation_modes import stretches_to_gradient
from calibrate.equations.inputs import INPUT_SETS, REFERENCE


def psi_of_inputs(energy, site_inputs):
    """d psi / d(J1, J2) (n, 2) of an energy at sampling points J - J(I) (n, 2)."""
    J = np.nan_to_num(site_inputs) + REFERENCE
    invariants = np.stack([J[:, 0], J[:, 1] ** (2 / 3)], axis=1)
    return derivatives(energy, invariants) / np.stack([np.ones(len(J)), 1.5 * np.sqrt(invariants[:, 1])], axis=1)


def basis_and_coefficients(inputs, F):
    """The default basis for F, and the coefficients of a smooth energy in it."""
    basis = bases.basis_for(inputs, F)
    energy = {"I1": ArrudaBoyce(), "I2": HartmannNeff(0.0, 0.02), "I1I2": HartmannNeff()}[inputs]
    return basis, basis.interpolation @ psi_of_inputs(energy, basis.site_inputs).ravel(), energy


@pytest.mark.parametrize("n", [6, 14, 32])
@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_splines_are_the_clamped_b_splines(n, derivative):
    spline, x = bases.Spline(n, -0.5, 2.0), np.linspace(-0.4999, 1.9999, 101)
    expected = BSpline(spline.knots, np.eye(n), 3).derivative(derivative)(x) if derivative else None
    if expected is None:
        expected = BSpline(spline.knots, np.eye(n), 3)(x)
    np.testing.assert_allclose(spline.matrix(x, derivative), expected, atol=1e-10 * np.abs(expected).max())


def test_splines_sum_to_one_and_clip():
    spline = bases.Spline(9)
    x = np.array([-1.0, 0.0, 0.3, 1.0, 4.0])
    values = spline.matrix(x)
    np.testing.assert_allclose(values.sum(axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(values[[0, -1]], values[[1, -2]], atol=1e-14)


@pytest.mark.parametrize("inputs", ["I1", "I2", "I1I2"])
def test_smooth_energies_are_reproduced(inputs):
    F = random_gradients(300, spread=0.35)
    basis, c, energy = basis_and_coefficients(inputs, F)
    psi, _ = basis.second(F, c)
    J, _ = bases.polyconvex(F)
    expected = psi_of_inputs(energy, J)
    np.testing.assert_allclose(psi, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("inputs", ["I1", "I2", "I1I2"])
def test_stress_of_the_functions_adds_up_to_the_stress_of_the_energy(inputs):
    F = random_gradients(200, spread=0.3)
    basis, c, energy = basis_and_coefficients(inputs, F)
    P, columns = basis.local(F)
    stress = np.einsum("mqij,mq->mij", P, c[columns])
    expected = np.asarray(kinematics.nominal_stress(energy, jnp.asarray(F)))
    np.testing.assert_allclose(stress, expected, atol=2e-6 * np.abs(expected).max())


@pytest.mark.parametrize("inputs", ["I1", "I2"])
def test_second_derivatives_against_finite_differences(inputs):
    F, h = random_gradients(40, seed=3, spread=0.3), 1e-6
    basis, c, _ = basis_and_coefficients(inputs, F)
    k = INPUT_SETS[inputs][0]
    J, _ = bases.polyconvex(F)
    far = J[:, k] > 0.01 * basis.top
    _, hessian = basis.second(F, c)
    s = lambda step: np.sqrt((J[:, k] + step) / basis.top)  # noqa: E731
    difference = (basis.spline.matrix(s(h)) - basis.spline.matrix(s(-h))) @ c / (2 * h)
    np.testing.assert_allclose(hessian[far, k, k], difference[far], rtol=1e-4, atol=1e-7)


def test_basis_covers_the_data():
    F = random_gradients(200)
    J, _ = bases.polyconvex(F)
    for inputs, k in (("I1", 0), ("I2", 1)):
        assert bases.basis_for(inputs, F).top > J[:, k].max()
    assert bases.basis_for("I1I2", F).top > bases.hencky_to_lode(F)[0].max()


def test_unknown_inputs_are_refused():
    with pytest.raises(errors.ConfigError):
        bases.basis_for("I4", random_gradients(3))


@pytest.mark.parametrize(("mode", "angle"), [("uniaxial", -np.pi / 6), ("pure_shear", 0.0), ("equibiaxial", np.pi / 6)])
def test_lode_angle_of_homogeneous_states(mode, angle):
    F = stretches_to_gradient(mode, np.array([1.2, 2.0, 3.0]))
    # arcsin has a vertical slope at +-pi/6: round-off of 1e-16 becomes 1e-8
    np.testing.assert_allclose(bases.hencky_to_lode(F)[1], angle, atol=1e-7)


def test_hencky_and_lode_are_inverse():
    rng = np.random.default_rng(0)
    norm, angle = rng.uniform(0.05, 2.0, 200), rng.uniform(-0.52, 0.52, 200)
    principal = bases.lode_to_hencky(norm, angle)
    np.testing.assert_allclose(principal.sum(axis=1), 0.0, atol=1e-14)
    assert (np.diff(principal, axis=1) <= 1e-12).all()
    F = np.zeros((200, 2, 2))
    for first, second in ((0, 1), (2, 0), (1, 2)):
        F[:, 0, 0], F[:, 1, 1] = np.exp(principal[:, first]), np.exp(principal[:, second])
        back = bases.hencky_to_lode(F)
        np.testing.assert_allclose(back[0], norm, rtol=1e-10)
        np.testing.assert_allclose(back[1], angle, atol=1e-6)
