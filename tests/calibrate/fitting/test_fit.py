"""The reduced loss, the convex first fit and the network fit on noise-free data of a known material."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from synthetic import ArrudaBoyce, HartmannNeff, MooneyRivlin, derivatives, plate_experiment, with_noise

from calibrate import errors
from calibrate.data.experiment import Noise
from calibrate.equations import basis as bases
from calibrate.equations import equilibrium as equations
from calibrate.equations import kinematics, noise_covariance, reduction
from calibrate.equations.inputs import REFERENCE
from calibrate.fitting import network_fit
from calibrate.fitting.stopping import Stop
from calibrate.models import pann

SPACING = 12.0


def assembled(energy, inputs):
    system = equations.equilibrium(plate_experiment(energy), SPACING)
    basis = bases.basis_for(inputs, system.deformation_gradients.reshape(-1, 2, 2))
    return reduction.assemble(system, basis)


def fitted_spline(energy, inputs):
    """Coefficients after two passes of the weighting, the quadratic of the last, and the equations."""
    equations_of_all = assembled(energy, inputs)
    c = equations_of_all.first_guess()
    for _ in range(2):
        quadratic = equations_of_all.quadratic(equations_of_all.weights(c))
        c = network_fit.convex_spline(quadratic, inputs)
    return c, quadratic, equations_of_all


@pytest.fixture(scope="module")
def arruda_boyce():
    return fitted_spline(ArrudaBoyce(), "I1")


def stress_error(c, energy, system, basis):
    """Largest error of the stress over all triangles and increments, relative to the largest stress."""
    F = system.deformation_gradients.reshape(-1, 2, 2)
    P, columns = basis.local(F)
    stress = np.einsum("mqij,mq->mij", P, c[columns])
    expected = np.asarray(kinematics.nominal_stress(energy, jnp.asarray(F)))
    return np.abs(stress - expected).max() / np.abs(expected).max()


# the quadratic form


def test_quadratic_is_the_sum_of_squares_of_the_whitened_equations(arruda_boyce):
    c, _, equations_of_all = arruda_boyce
    quadratic = equations_of_all.quadratic(equations_of_all.weights(c))
    other = c * np.linspace(0.5, 1.5, c.size)
    G, load = equations_of_all.weighted_equations(equations_of_all.weights(c))
    assert quadratic.loss(other) == pytest.approx(((G @ other - load) ** 2).sum(), rel=1e-9)
    assert quadratic.n_rows == load.size


def test_whitened_residuals_have_unit_covariance():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((6, 9))
    lower = noise_covariance.cholesky_factor(root @ root.T)
    white = np.linalg.solve(lower, root)
    np.testing.assert_allclose(white @ white.T, np.eye(6), atol=1e-7)


def test_factor_of_a_quadratic(arruda_boyce):
    c, quadratic, _ = arruda_boyce
    R, d = quadratic.factor()
    rng = np.random.default_rng(0)
    for scale in (0.0, 1e-2, 1.0):
        other = c * (1 + scale * rng.standard_normal(c.size))
        expected = np.sum((R @ other - d) ** 2) + quadratic.constant - d @ d
        assert quadratic.loss(other) == pytest.approx(expected, abs=1e-8 * quadratic.constant)
    np.testing.assert_allclose(R.T @ R, quadratic.Q, atol=1e-9 * np.abs(quadratic.Q).max())


def test_factor_drops_directions_without_information():
    basis = bases.SingleBasis(0, 1.0, 6)
    rng = np.random.default_rng(0)
    root = rng.standard_normal((4, 6))
    quadratic = reduction.Quadratic(basis, root.T @ root, root.T @ np.ones(4), 4.0, 4)
    R, d = quadratic.factor()
    assert R.shape == (4, 6)
    np.testing.assert_allclose(R.T @ R, quadratic.Q, atol=1e-12)
    np.testing.assert_allclose(R.T @ d, quadratic.q, atol=1e-12)


def test_losses_of_two_experiments_add(arruda_boyce):
    c, quadratic, _ = arruda_boyce
    double = quadratic + quadratic
    assert double.loss(0.9 * c) == pytest.approx(2 * quadratic.loss(0.9 * c))
    assert double.n_rows == 2 * quadratic.n_rows
    other = reduction.Quadratic(bases.SingleBasis(0, 1.0), quadratic.Q, quadratic.q, 0.0, 1)
    with pytest.raises(ValueError, match="basis"):
        quadratic + other


# the convex spline


@pytest.mark.parametrize(
    ("energy", "inputs", "tolerance"),
    [
        (ArrudaBoyce(), "I1", 1e-3),
        (HartmannNeff(0.0, 0.02), "I2", 1e-3),
        (HartmannNeff(), "I1I2", 2e-3),
    ],
    ids=["ArrudaBoyce", "I2^1.5", "HartmannNeff"],
)
def test_convex_spline_recovers_the_material(energy, inputs, tolerance):
    c, _, equations_of_all = fitted_spline(energy, inputs)
    assert stress_error(c, energy, equations_of_all.system, equations_of_all.basis) < tolerance


def test_convex_spline_of_mooney_rivlin_is_no_worse_than_hartmann_neff():
    """c01 (I2 - 3) is concave in J2 = I2^(3/2), so that no energy of the class is equal to it.

    c1 (J1 - 3) + c2 (J2 - 3^(3/2)) is in the class: the global optimum cannot lie above its best loss.
    """
    c, quadratic, _ = fitted_spline(MooneyRivlin(), "I1I2")
    basis = quadratic.basis
    constants = np.zeros((2, len(basis.site_inputs), 2))
    constants[0, :, 0] = constants[1, :, 1] = 1.0
    E = basis.interpolation @ constants.reshape(2, -1).T
    best = E @ np.linalg.solve(E.T @ quadratic.Q @ E, E.T @ quadratic.q)
    assert quadratic.loss(c) < (1 + 1e-9) * quadratic.loss(best)
    slopes = (np.linalg.pinv(basis.interpolation) @ c).reshape(-1, 2)
    for k in (0, 1):
        in_order = slopes[np.argsort(basis.site_inputs[:, k]), k]
        assert in_order.min() >= -1e-12 * in_order.max()  # the pseudo-inverse gives slopes of zero to round-off
        assert np.diff(in_order).min() > -1e-9 * in_order.max()


def test_both_inputs_do_not_spoil_a_fit_that_needs_one():
    """Functions of J2 beyond the data must not act through the ripples of the tensor basis."""
    noise = Noise(0.03, 2.5, force_std=0.005)
    errors_of = {}
    for inputs in ("I1", "I1I2"):
        system = equations.equilibrium(with_noise(plate_experiment(), noise, 0), SPACING)
        basis = bases.basis_for(inputs, system.deformation_gradients.reshape(-1, 2, 2))
        noisy = reduction.assemble(system, basis)
        c = network_fit.convex_spline(noisy.quadratic(noisy.weights(noisy.first_guess())), inputs)
        exact = equations.equilibrium(plate_experiment(), SPACING)
        errors_of[inputs] = stress_error(c, ArrudaBoyce(), exact, basis)
    assert errors_of["I1I2"] < 2 * errors_of["I1"]


def test_convex_spline_is_convex_and_non_decreasing(arruda_boyce):
    c, quadratic, _ = arruda_boyce
    basis = quadratic.basis
    slope = basis.spline.matrix(np.linspace(0, 1, 400)) @ c
    assert slope.min() >= 0
    assert np.diff(slope).min() >= -1e-6 * slope.max()


def test_building_blocks_of_the_convex_spline():
    basis = bases.SingleBasis(0, 5.0)
    functions = network_fit.monotone_functions(basis, 0, 12)
    assert functions.shape == (12, 32, 2)
    np.testing.assert_allclose(functions[0, :, 0], 1.0, atol=1e-12)
    assert (np.diff(functions[:, :, 0], axis=1) >= -1e-12).all()
    assert functions[:, :, 0].min() >= -1e-12


@pytest.mark.parametrize("reach", [1.5, 5.0, np.inf])
def test_building_blocks_are_constant_beyond_what_is_fitted(reach):
    basis = bases.SingleBasis(0, 5.0)
    beyond = network_fit.monotone_functions(basis, 0, 12, reach)[:, basis.site_inputs[:, 0] >= min(reach, 5.0), 0]
    assert beyond.shape[1] > 0
    np.testing.assert_allclose(beyond, beyond[:, :1] * np.ones(beyond.shape[1]), atol=1e-12)


def test_a_convex_spline_does_not_run_away_beyond_what_is_fitted(arruda_boyce):
    """Of functions that act on the fitted range alone; the loss knows nothing of what is beyond."""
    c, quadratic, _ = arruda_boyce
    basis, reach = quadratic.basis, 0.3 * quadratic.basis.site_inputs[:, 0].max()
    columns = basis.spline.matrix(np.linspace(0, np.sqrt(reach / basis.top), 200))
    seen = reduction.Quadratic(
        basis, columns.T @ columns, columns.T @ (columns @ c), float(c @ columns.T @ columns @ c), 200
    )
    slope = basis.spline.matrix(np.linspace(0, 1, 400)) @ network_fit.convex_spline(seen, "I1", reach=reach)
    assert slope.max() < 1.5 * (columns @ c).max()


def test_data_without_information_are_refused():
    basis = bases.SingleBasis(0, 1.0, 6)
    empty = reduction.Quadratic(basis, np.zeros((6, 6)), np.zeros(6), 0.0, 3)
    with pytest.raises(errors.FitError):
        network_fit.convex_spline(empty, "I1")


def test_a_zero_spline_is_refused(arruda_boyce):
    _, quadratic, _ = arruda_boyce
    with pytest.raises(errors.FitError, match="zero"):
        network_fit.fit_network(quadratic, "I1", (1,), np.zeros(quadratic.basis.n_functions))


# the network


@pytest.mark.parametrize(("inputs", "layers"), [("I1", (2, 2)), ("I1I2", (2,))])
def test_network_recovers_the_material(inputs, layers):
    energy = ArrudaBoyce() if inputs == "I1" else HartmannNeff()
    c, quadratic, _equations_of_all = fitted_spline(energy, inputs)
    architecture, result = network_fit.fit_network(quadratic, inputs, layers, c, n_starts=6)
    assert (result.parameters[architecture.nonnegative] >= 0).all()
    assert result.losses.shape == (6,)
    assert len(result.reasons) == 6
    assert result.loss == pytest.approx(result.losses.min())
    assert all(isinstance(reason, Stop) for reason in result.reasons)
    invariants = np.stack([np.linspace(3, 6, 30)] * 2, axis=1)
    fitted = jax.jit(pann.energy_derivatives, static_argnums=0)(
        architecture, jnp.asarray(result.parameters), jnp.asarray(invariants)
    )
    error = np.abs(np.asarray(fitted) - derivatives(energy, invariants)).max()
    assert error < 0.01 * derivatives(energy, invariants).max()


def test_network_loss_is_the_loss_of_its_spline_interpolant(arruda_boyce):
    c, quadratic, _ = arruda_boyce
    architecture, result = network_fit.fit_network(quadratic, "I1", (2, 2), c, n_starts=6)
    J1 = quadratic.basis.site_inputs[:, 0] + REFERENCE[0]
    psi = jax.jit(pann.energy_derivatives, static_argnums=0)(
        architecture, jnp.asarray(result.parameters), jnp.stack([J1, jnp.full(J1.shape, 3.0)], axis=1)
    )
    interpolant = quadratic.basis.interpolation @ np.asarray(psi).ravel()
    assert quadratic.loss(interpolant) == pytest.approx(result.loss, abs=1e-7 * quadratic.constant)


def test_same_seed_same_fit(arruda_boyce):
    c, quadratic, _ = arruda_boyce
    first, second = (network_fit.fit_network(quadratic, "I1", (2, 2), c, n_starts=6, seed=3)[1] for _ in range(2))
    np.testing.assert_array_equal(first.parameters, second.parameters)
