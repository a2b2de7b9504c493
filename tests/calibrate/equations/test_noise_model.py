"""The noise factor against the covariance it stands for, and what noise does to the equations."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import ArrudaBoyce, derivatives, plate_experiment, with_noise

from calibrate.data import load_path
from calibrate.data.experiment import Noise
from calibrate.equations import basis as bases
from calibrate.equations import equilibrium as equations
from calibrate.equations import noise_covariance, reduction
from calibrate.equations.inputs import REFERENCE
from calibrate.errors import ConfigError

NOISE = Noise(displacement_std=0.02, correlation_length=2.5, force_std=0.01)
SPACING = 12.0


def stated_covariance(points, noise):
    distance2 = ((points[:, None] - points[None]) ** 2).sum(axis=2)
    return noise.displacement_std**2 * np.exp(-distance2 / (2 * noise.correlation_length**2))


def true_coefficients(basis):
    J1 = basis.site_inputs[:, 0] + REFERENCE[0]
    psi = derivatives(ArrudaBoyce(), np.stack([J1, np.full_like(J1, 3.0)], axis=1))
    return basis.interpolation @ psi.ravel()


def covariance_of(system, basis, c, F, factor, noise, increment=0):
    spread = noise_covariance.spread(system, basis, c, F, factor)
    return noise_covariance.covariance_of(system, spread, system.loads[increment], noise)


@pytest.mark.parametrize("length", [1.0, 2.5, 6.0])
def test_factor_reproduces_the_stated_covariance(length):
    points = np.random.default_rng(0).uniform(-15, 15, (250, 2))
    noise = Noise(0.03, length)
    factor = noise_covariance.noise_factor(points, noise)
    covariance = (factor @ factor.T).toarray()
    # sources 0.7 l apart, cut off at 3.2 l
    np.testing.assert_allclose(covariance, stated_covariance(points, noise), atol=3e-4 * noise.displacement_std**2)
    np.testing.assert_allclose(np.diag(covariance), noise.displacement_std**2, rtol=1e-12)


def test_uncorrelated_noise_is_white():
    points = np.random.default_rng(0).uniform(-15, 15, (50, 2))
    factor = noise_covariance.noise_factor(points, Noise(0.03, 0.0)).toarray()
    np.testing.assert_array_equal(factor, 0.03 * np.eye(50))


def test_samples_have_the_stated_covariance():
    points = np.stack(np.meshgrid(np.arange(5.0), np.arange(3.0)), axis=-1).reshape(-1, 2)
    factor = noise_covariance.noise_factor(points, NOISE)
    n = 20000
    fields = noise_covariance.sample(factor, np.random.default_rng(1), n)
    assert fields.shape == (n, 15, 2)
    variance = NOISE.displacement_std**2
    # standard error of a covariance from n samples: at most sqrt(2 / n) of the variance; 5 of them
    for a, b, expected in ((0, 0, stated_covariance(points, NOISE)), (0, 1, np.zeros((15, 15)))):
        empirical = fields[..., a].T @ fields[..., b] / n
        np.testing.assert_allclose(empirical, expected, atol=5 * np.sqrt(2 / n) * variance)
    between_increments = fields[1:, :, 0].T @ fields[:-1, :, 0] / n
    np.testing.assert_allclose(between_increments, 0, atol=5 * np.sqrt(1 / n) * variance)


def test_predicted_residual_covariance_is_the_empirical_one():
    """Small noise through the full nonlinear chain, 200 seeds, against K Sigma K^T + Sigma_force."""
    noise = Noise(1e-4, 2.5, force_std_relative=1e-4, force_std=1e-3)
    clean = plate_experiment(n_increments=1, n_theta=24, n_radial=4)
    system = equations.equilibrium(clean, SPACING)
    basis = bases.basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2))
    c = true_coefficients(basis)
    factor = noise_covariance.noise_factor(clean.points, noise)
    F = system.deformation_gradients[0]
    predicted = covariance_of(system, basis, c, F, factor, noise)
    residuals = []
    for seed in range(200):
        noisy = equations.Equilibrium(with_noise(clean, noise, seed), system.fields)
        residuals.append(noisy.matrix(basis, noisy.deformation_gradients[0]) @ c - noisy.loads[0])
    variance = np.mean(np.square(residuals), axis=0) / np.diag(predicted)
    assert np.abs(variance - 1).max() < 5 * np.sqrt(2 / 200)
    assert abs(variance.mean() - 1) < 0.05


@pytest.mark.slow
def test_the_stated_deviation_of_the_stiffness_knows_what_increments_have_in_common():
    """Pulls of one modulus over 40 seeds: 1 with the joint covariance, more with all noise taken for new in every increment."""
    stated = Noise(0.005, 2.5, force_std_relative=1e-5, pattern_std=0.03, reference_std=0.02)
    alone = Noise(stated.total_std, 2.5, force_std_relative=1e-5)
    clean = plate_experiment(n_increments=4, n_theta=24, n_radial=4)
    pulls = []
    for seed in range(40):
        noisy = with_noise(clean, stated, seed)
        pulls.append([_pull(replace(noisy, noise=noise)) for noise in (stated, alone)])
    joint, independent = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert joint == pytest.approx(1.0, abs=3 / np.sqrt(2 * 40))
    assert independent > joint


def _pull(experiment):
    """Error of the best factor on the true coefficients, over its stated standard deviation."""
    system = equations.equilibrium(experiment, SPACING)
    basis = bases.basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2))
    c = true_coefficients(basis)
    quadratic = reduction.assemble(system, basis).quadratic(c)
    return (quadratic.stiffness_factor(c) - 1) * np.sqrt(c @ quadratic.Q @ c)


@pytest.mark.slow
def test_covariance_between_increments_is_the_empirical_one():
    """Pattern and reference: the products of residuals of two increments against the joint covariance."""
    noise = Noise(5e-5, 2.5, force_std_relative=1e-4, pattern_std=2e-4, reference_std=1e-4)
    clean = plate_experiment(n_increments=2, n_theta=24, n_radial=4)
    system = equations.equilibrium(replace(clean, noise=noise), SPACING)
    basis = bases.basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2))
    c = true_coefficients(basis)
    (predicted,) = reduction.assemble(system, basis).noise_covariances(c)
    residuals = []
    for seed in range(200):
        noisy = equations.Equilibrium(with_noise(clean, noise, seed), system.fields)
        residuals.append([noisy.matrix(basis, F) @ c for F in noisy.deformation_gradients] - noisy.loads)
    every = np.reshape(residuals, (200, -1))
    deviation = np.sqrt(np.diag(predicted))
    correlation = (every - every.mean(axis=0)).T @ every / 199 / np.outer(deviation, deviation)
    expected = predicted / np.outer(deviation, deviation)
    assert 0.6 < np.median(np.diag(expected[: len(expected) // 2, len(expected) // 2 :])) < 0.95
    assert np.abs(correlation - expected).max() < 6 * np.sqrt(2 / 200)
    np.testing.assert_allclose(
        reduction.assemble(system, basis).variances, 1 + 16 * system.experiment.deformation_shares**2 + 4
    )
    half = len(predicted) // 2
    for own, block in zip(
        reduction.assemble(system, basis).own_covariances(c),
        (predicted[:half, :half], predicted[half:, half:]),
        strict=True,
    ):
        np.testing.assert_allclose(own, block, atol=1e-12 * np.abs(block).max())


@pytest.mark.parametrize("common", [0.0, 0.04])
def test_loss_of_the_true_model_is_a_chi_square(common):
    """Loss / equations at the true material: 1 within 5 standard errors over seeds; `common` (mm) of pattern and reference."""
    clean = plate_experiment(n_increments=2)
    stated = replace(NOISE, pattern_std=common, reference_std=common)
    ratios = []
    for seed in range(6):
        system = equations.equilibrium(with_noise(clean, stated, seed), SPACING)
        basis = bases.basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2))
        quadratic = reduction.assemble(system, basis).quadratic(true_coefficients(basis))
        ratios.append(quadratic.loss(true_coefficients(basis)) / quadratic.n_rows)
    standard_error = np.sqrt(2 / quadratic.n_rows / len(ratios))
    assert abs(np.mean(ratios) - 1) < 5 * standard_error


def test_covariance_of_many_increments_is_known_from_samples(monkeypatch):
    """Of 30 increments, from half of them: within 2 % of the standard deviations of that from all."""
    noise = Noise(5e-5, 2.5, pattern_std=2e-4)
    clean = plate_experiment(n_increments=30, n_theta=24, n_radial=4)
    system = equations.equilibrium(replace(clean, noise=noise), SPACING)
    basis = bases.basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2))
    c = true_coefficients(basis)
    some = reduction.assemble(system, basis)
    (found,) = some.noise_covariances(c)
    monkeypatch.setattr(load_path, "SAMPLE", 0.0)
    every = reduction.assemble(system, basis)
    (expected,) = every.noise_covariances(c)
    assert len(some.samples[0]) < 17 and len(every.samples[0]) == 30
    deviation = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        found / np.outer(deviation, deviation), expected / np.outer(deviation, deviation), atol=0.02
    )


def test_opposite_grips_that_one_load_cell_reads_are_wrong_together():
    """The covariance of their equations is that of one error with both signs; forces that two cells read have an error each."""
    noise = Noise(0.0, 1.0, force_std_relative=1e-3, force_std=0.01)
    clean = plate_experiment(n_increments=2, n_theta=24, n_radial=4)
    one, other = (replace(b, force=sign * clean.loaded[0].force) for b, sign in zip(clean.loaded, (1, -1), strict=True))
    system = equations.equilibrium(replace(clean, loaded=(one, other)), SPACING)
    rng = np.random.default_rng(0)
    for two_cells in (False, True):
        if two_cells:
            apart = replace(other, force=other.force * (1 + 1e-4 * rng.standard_normal((2, 1))))
            system = equations.Equilibrium(replace(clean, loaded=(one, apart)), system.fields)
        load = system.loads[1]
        found = noise_covariance.covariance_of(system, np.zeros((len(load), 0)), load, noise)
        rows = [int(np.flatnonzero(system.fields.boundary == b)[0]) for b in range(2)]
        deviation = 1e-3 * np.abs(load[rows]) + 0.01
        correlation = found[np.ix_(rows, rows)] / np.outer(deviation, deviation)
        expected = np.eye(2) if two_cells else np.array([[1, -1], [-1, 1]])
        np.testing.assert_allclose(correlation, expected, atol=1e-12)


def test_too_many_pictures_with_noise_in_common_are_refused(monkeypatch):
    noise = Noise(5e-5, 2.5, pattern_std=2e-4)
    clean = plate_experiment(n_increments=4, n_theta=24, n_radial=4)
    system = equations.equilibrium(replace(clean, noise=noise), SPACING)
    rows = system.loads.shape[1]
    monkeypatch.setattr(noise_covariance, "MOST_ROWS", 3 * rows + 1)
    basis = bases.basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2))
    with pytest.raises(ConfigError, match=r"4 pictures have noise in common.*--pictures 3"):
        list(reduction.assemble(system, basis).noise_covariances(true_coefficients(basis)))
    alone = equations.Equilibrium(replace(clean, noise=Noise(5e-5, 2.5)), system.fields)
    assert len(list(reduction.assemble(alone, basis).noise_covariances(true_coefficients(basis)))) == 4
