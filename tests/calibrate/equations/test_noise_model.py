"""The noise factor against the covariance it stands for, and what noise does to the equations."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from synthetic import ArrudaBoyce, derivatives, plate_experiment, with_noise

from calibrate.data import load_path
from calibrate.data.experiment import Noise
from calibrate.data.measurement import first_of_cell, one_cell
from calibrate.equations import basis as bases
from calibrate.equations import equilibrium as equations
from calibrate.equations import noise_covariance, reduction, weights
from calibrate.equations.inputs import REFERENCE
from calibrate.equations.weights import memory, weights_of

NOISE = Noise(displacement_std=0.02, correlation_length=2.5, force_std=0.01)
SPACING = 12.0


def stated_covariance(points, noise):
    distance2 = ((points[:, None] - points[None]) ** 2).sum(axis=2)
    return noise.displacement_std**2 * np.exp(-distance2 / (2 * noise.correlation_length**2))


def true_coefficients(basis):
    J1 = basis.site_inputs[:, 0] + REFERENCE[0]
    psi = derivatives(ArrudaBoyce(), np.stack([J1, np.full_like(J1, 3.0)], axis=1))
    return basis.interpolation @ psi.ravel()


def dense(noise):
    """Covariance of all increments together."""
    between, deviations = noise.own + noise.common @ noise.common.T, noise.deviations
    t, r = deviations.shape
    spreads = np.tensordot(noise.shares, noise.spreads, 1).reshape(t * r, -1)
    found = np.kron(between, np.ones((r, r))) * (spreads @ spreads.T)
    return found + np.kron(np.eye(t), noise.correlation) * np.outer(deviations, deviations)


def covariance_of(system, basis, c, F, factor, noise, increment=0):
    spread = noise_covariance.spread(system, basis, c, F, factor)
    return noise_covariance.covariance_of(system, spread, system.loads[increment], noise)


def test_rows_by_sources_are_the_product_with_either_kind_of_factor():
    rng = np.random.default_rng(0)
    rows, factor = [rng.standard_normal((7, 30)) for _ in range(2)], np.tril(rng.standard_normal((30, 30)))
    expected = np.hstack([one @ factor for one in rows])
    np.testing.assert_allclose(noise_covariance.by_sources(rows, factor), expected, atol=1e-13)
    np.testing.assert_allclose(noise_covariance.by_sources(rows, sp.csr_array(factor)), expected, atol=1e-13)


@pytest.mark.parametrize("length", [1.0, 2.5, 6.0])
def test_factor_reproduces_the_stated_covariance(length):
    points = np.random.default_rng(0).uniform(-15, 15, (250, 2))
    noise = Noise(0.03, length)
    factor = noise_covariance.factor_of_points(points, noise)
    covariance = (factor @ factor.T).toarray()
    # sources 0.7 l apart, cut off at 3.2 l
    np.testing.assert_allclose(covariance, stated_covariance(points, noise), atol=3e-4 * noise.displacement_std**2)
    np.testing.assert_allclose(np.diag(covariance), noise.displacement_std**2, rtol=1e-12)


def test_uncorrelated_noise_is_white():
    points = np.random.default_rng(0).uniform(-15, 15, (50, 2))
    factor = noise_covariance.factor_of_points(points, Noise(0.03, 0.0)).toarray()
    np.testing.assert_array_equal(factor, 0.03 * np.eye(50))


def test_samples_have_the_stated_covariance():
    points = np.stack(np.meshgrid(np.arange(5.0), np.arange(3.0)), axis=-1).reshape(-1, 2)
    factor = noise_covariance.factor_of_points(points, NOISE)
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
    factor = noise_covariance.noise_factor(clean, noise)
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
    assembled = reduction.assemble(system, basis)
    quadratic = assembled.quadratic(assembled.weights(c))
    return (quadratic.stiffness_factor(c) - 1) * np.sqrt(c @ quadratic.Q @ c)


@pytest.mark.slow
def test_covariance_between_increments_is_the_empirical_one():
    """Pattern and reference: the products of residuals of two increments against the joint covariance."""
    noise = Noise(5e-5, 2.5, force_std_relative=1e-4, pattern_std=2e-4, reference_std=1e-4)
    clean = plate_experiment(n_increments=2, n_theta=24, n_radial=4)
    one, other = clean.loaded
    clean = replace(clean, loaded=(one, replace(other, force=(1 + 1e-6) * other.force)))  # two load cells
    system = equations.equilibrium(replace(clean, noise=noise), SPACING)
    basis = bases.basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2))
    c = true_coefficients(basis)
    seen = reduction.assemble(system, basis).noise_at(c)
    predicted = dense(seen)
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
    for i, block in enumerate((predicted[:half, :half], predicted[half:, half:])):
        np.testing.assert_allclose(seen.increment(i), block, atol=1e-12 * np.abs(block).max())


@pytest.mark.parametrize("common", [0.0, 0.04])
def test_loss_of_the_true_model_is_a_chi_square(common):
    """Loss / equations at the true material: 1 within 5 standard errors over seeds; `common` (mm) of pattern and reference."""
    clean = plate_experiment(n_increments=2)
    stated = replace(NOISE, pattern_std=common, reference_std=common)
    ratios = []
    for seed in range(6):
        system = equations.equilibrium(with_noise(clean, stated, seed), SPACING)
        basis = bases.basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2))
        assembled = reduction.assemble(system, basis)
        quadratic = assembled.quadratic(assembled.weights(true_coefficients(basis)))
        ratios.append(quadratic.loss(true_coefficients(basis)) / quadratic.n_rows)
    standard_error = np.sqrt(2 / quadratic.n_rows / len(ratios))
    assert abs(np.mean(ratios) - 1) < 5 * standard_error


def test_covariance_of_many_increments_is_known_from_samples(monkeypatch):
    """Of 30 increments, from seven of them: within 1 % of the standard deviations of that from all."""
    noise = Noise(5e-5, 2.5, pattern_std=2e-4)
    clean = plate_experiment(n_increments=30, n_theta=24, n_radial=4)
    system = equations.equilibrium(replace(clean, noise=noise), SPACING)
    basis = bases.basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2))
    c = true_coefficients(basis)
    some = reduction.assemble(system, basis)
    found = dense(some.noise_at(c))
    monkeypatch.setattr(load_path, "LINE", 0.0)
    every = reduction.assemble(system, basis)
    expected = dense(every.noise_at(c))
    assert len(some.samples[0]) == 7 and len(every.samples[0]) == 30
    deviation = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        found / np.outer(deviation, deviation), expected / np.outer(deviation, deviation), atol=0.01
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
        deviation = np.hypot(1e-3 * load[rows], 0.01)
        correlation = found[np.ix_(rows, rows)] / np.outer(deviation, deviation)
        expected = np.eye(2) if two_cells else np.array([[1, -1], [-1, 1]])
        np.testing.assert_allclose(correlation, expected, atol=1e-12)


PARTS = {"force_std_relative": 1e-3, "force_std": 1e-3}
COMMON = {"pattern_std": 4e-3, "reference_std": 2e-3}


@pytest.mark.parametrize(
    ("noise", "rows", "close"),
    [
        (Noise(1e-3, 2.5, **PARTS), "some", 1e-7),  # the floor of a Cholesky factor
        (Noise(1e-3, 2.5, **PARTS, **COMMON), "all", 2e-3),
        (Noise(1e-3, 2.5, **PARTS, **COMMON), "some", 2e-3),
        (Noise(1e-3, 2.5, **PARTS, correlation_time=8.0), "all", 2e-3),
        (Noise(1e-3, 2.5, **PARTS, **COMMON, correlation_time=8.0), "some", 2e-3),
    ],
)
@pytest.mark.parametrize("most", [0, weights.DENSE], ids=["sources", "covariance"])
def test_weights_have_the_determinant_and_the_squares_of_the_dense_covariance(noise, rows, close, most, monkeypatch):
    """To `close` a row: white noise is exact, of noise in common what is `NEGLIGIBLE` is left out, and a drift that the changing tangent mixes is told
    nearly by the increment before. Some: a third of the increments is left out, and another has some of its rows only."""
    monkeypatch.setattr(weights, "DENSE", most)
    clean = plate_experiment(n_increments=6, n_theta=24, n_radial=4)
    system = equations.equilibrium(replace(clean, noise=noise), SPACING)
    basis = bases.basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2))
    seen, used = reduction.assemble(system, basis).noise_at(true_coefficients(basis)), np.isfinite(system.loads)
    if rows == "some":
        used &= np.arange(6)[:, None] % 3 != 1
        used[3, ::2] = False
    found = weights_of(seen, used)
    covariance = dense(seen)[np.ix_(used.ravel(), used.ravel())]
    W = found(np.eye(used.size)[used.ravel()].reshape(-1, *used.shape)).T
    unit = W @ covariance @ W.T
    assert abs(found.log_determinant - np.linalg.slogdet(covariance)[1]) < close * len(unit)
    assert ((unit - np.eye(len(unit))) ** 2).mean() < close**2
    if not noise.correlation_time:  # what is left out was told to be below that in every direction
        values = np.linalg.eigvalsh(unit)
        # 2e-6: the floor of a Cholesky factor, 1e-10 of the variance, over the smallest share of it that is new in an increment
        assert values[0] > 1 - 2e-6 and values[-1] < 1 + noise_covariance.NEGLIGIBLE
    draws = np.zeros((50, *used.shape))
    draws[:, used] = (np.linalg.cholesky(covariance) @ np.random.default_rng(0).standard_normal((len(unit), 50))).T
    exact = np.einsum("ni,ni->n", draws[:, used], np.linalg.solve(covariance, draws[:, used].T).T)
    np.testing.assert_allclose((found(draws) ** 2).sum(axis=1), exact, rtol=10 * close)
    r, z = draws[0], np.random.default_rng(1).standard_normal(found.size)
    assert (found.adjoint(z) * r).sum() == pytest.approx(z @ found(r), rel=1e-9)
    np.testing.assert_allclose(found.variance[used], np.diag(covariance), rtol=1e-9)


def test_increments_before_one_that_tell_of_it():
    """None of white noise, one of an exponential; of sums of pictures, those with the pictures that they are made of."""
    time = np.array([0.0, 1.0, 1.5, 4.0, 5.0, 7.0])
    assert memory(np.eye(6)) == 0
    assert memory(np.exp(-np.abs(np.subtract.outer(time, time)) / 2.0)) == 1
    W = np.eye(4)[[0, 1, 1, 2, 3]]
    W[2] = [0.0, 0.5, 0.5, 0.0]
    assert memory(W @ W.T) == 2  # the picture after the sum is known from it and from the one before


def test_samples_of_a_drift_have_its_covariance():
    """Between increments exp(-t / tau), at each point and component."""
    clean = plate_experiment(n_increments=5, n_theta=24, n_radial=4)
    noise = Noise(0.02, 2.5, correlation_time=3.0)
    timed = replace(clean, time=np.array([1.0, 2.0, 4.0, 7.0, 8.0]))
    M = noise_covariance.between_increments(timed, noise)
    np.testing.assert_allclose(M, np.exp(-np.abs(np.subtract.outer(timed.time, timed.time)) / 3.0))
    factor = noise_covariance.noise_factor(clean, noise)
    fields = np.array([noise_covariance.common_sample(factor, np.random.default_rng(k), M) for k in range(400)])
    found = np.einsum("ktnc,kunc->tu", fields, fields) / fields[:, 0].size / 0.02**2
    np.testing.assert_allclose(found, M, atol=5 * np.sqrt(2 / 400 / 10))  # ten independent places on the plate at least


def test_one_cell_reads_what_is_opposite_wherever_both_are_known():
    left = np.array([1.0, 2.0, np.nan, 4.0])
    forces = np.stack([left, -np.nan_to_num(left, nan=3.0), -left * (1 + 1e-5), 0 * left, np.full(4, np.nan)], axis=1)
    expected = np.zeros((5, 5), bool)
    expected[0, 1] = expected[1, 0] = True
    np.testing.assert_array_equal(one_cell(forces), expected)
    first = first_of_cell(forces)
    np.testing.assert_array_equal(
        np.isfinite(first[:, :2]), [[True, False], [True, False], [False, True], [True, False]]
    )
    np.testing.assert_array_equal(first[:, 2:], forces[:, 2:])
