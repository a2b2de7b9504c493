"""What increments have in common of the noise, and its drift: of numbers drawn with known variances, and of simulated tests."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import synthetic

from calibrate.data.experiment import Noise
from calibrate.fitting.noise.common_noise import CommonRatios, common_ratios
from calibrate.fitting.noise.noise_check import check_noise

SHARES = np.array([0.2, 0.5, 0.75, 1.0])


CLOCK = np.array([0.0, 1.0, 2.0, 3.0, 6.0, 7.0, 8.0, 9.0])  # runs of neighbours


def drawn(pattern, reference, seed, n=800, outliers=0, shares=SHARES, own=None):
    """y (n, k) and correlations (n, k, k) that differ from field to field."""
    rng, k = np.random.default_rng(seed), len(shares)
    directions = np.array([1.0, 0.0, 0.0]) + 0.25 * rng.standard_normal((n, k, 3))
    directions /= np.linalg.norm(directions, axis=2)[:, :, None]
    R = directions @ directions.transpose(0, 2, 1)
    covariance = (np.eye(k) if own is None else own) + pattern * np.outer(shares, shares) + reference
    root = np.linalg.cholesky(covariance * R + 1e-12 * np.eye(k))
    y = 0.01 * (root @ rng.standard_normal((n, k, 1)))[:, :, 0]
    y[:outliers] += 2.0 * shares
    return y, R


@pytest.mark.parametrize(("rho", "common"), [(0.3, 0.0), (0.95, 0.0), (0.8, 1.0)])
def test_a_drift_is_found_with_its_time_and_taken_for_nothing_else(rho, common):
    """The correlation between neighbours, over four seeds; pattern and reference where they are there."""
    shares, own = (CLOCK + 1) / 10, rho ** np.abs(np.subtract.outer(CLOCK, CLOCK))
    found = [
        common_ratios(*drawn(common, common, seed, 300, shares=shares, own=own), shares, CLOCK) for seed in range(4)
    ]
    assert np.exp(-1 / np.mean([one.time for one in found])) == pytest.approx(rho, abs=0.05)
    if common:
        np.testing.assert_allclose(np.mean([one[:2] for one in found], axis=0), common, atol=0.4)
    else:
        assert all(one[:2] == (0.0, 0.0) for one in found)


def test_no_drift_is_found_in_what_is_in_common():
    shares = (CLOCK + 1) / 10
    found = [common_ratios(*drawn(1.0, 1.0, seed, 300, shares=shares), shares, CLOCK) for seed in range(4)]
    assert all(one.time == 0 and one.pattern > 0 and one.reference > 0 for one in found)


@pytest.mark.parametrize(("pattern", "reference"), [(4.0, 0.5), (0.0, 1.0), (19.0, 19.0)])
def test_variances_are_found(pattern, reference):
    found = np.mean([common_ratios(*drawn(pattern, reference, seed, outliers=30), SHARES) for seed in range(3)], axis=0)
    whole = 1 + pattern + reference
    np.testing.assert_allclose(found, [pattern, reference, 0.0], atol=0.1 * whole)


def test_none_are_found_where_increments_are_independent():
    """Of 30 seeds; each number counts as found by chance with a probability of 1 %."""
    found = [common_ratios(*drawn(0.0, 0.0, seed, 200), SHARES, CLOCK[:4]) for seed in range(30)]
    assert sum(one != CommonRatios() for one in found) <= 2
    y, R = drawn(4.0, 4.0, 0)
    assert common_ratios(y[:, :1], R[:, :1, :1], SHARES[:1]) == CommonRatios()


def test_a_drift_beside_far_more_in_common_is_none():
    """An error of the material that grows with the deformation and bends."""
    shares, own = (CLOCK + 1) / 10, np.exp(-np.abs(np.subtract.outer(CLOCK, CLOCK)) / 2)
    y, R = drawn(1e6, 0.0, 0, 300, shares=shares, own=own)
    assert common_ratios(y, R, shares, CLOCK).time == 0


@cache
def clean(c01=0.0):
    return synthetic.plate_experiment(synthetic.MooneyRivlin(0.15, c01), n_increments=4, n_theta=60, n_radial=12)


@pytest.mark.slow
def test_noise_common_to_the_increments_is_found_where_it_is_not_stated():
    """Over four seeds, where nothing is stated and where a standard deviation alone is; what is stated with it, and agrees, is kept."""
    true = Noise(0.01, 3.0, 1e-3, 0.0, 0.03, 0.02)
    alone = Noise(true.total_std, 3.0, 1e-3)
    tests = [synthetic.with_noise(clean(), true, seed) for seed in range(4)]
    for stated in (None, alone):
        checks = [check_noise(replace(e, noise=stated)) for e in tests]
        assert all(check.common_found and check.corrected for check in checks)
        for name in ("displacement_std", "pattern_std", "reference_std"):
            found = np.mean([getattr(check.used, name) for check in checks])
            assert found == pytest.approx(getattr(true, name), rel=0.2)
    half = [check_noise(replace(e, noise=true.scaled(0.5))) for e in tests]
    assert np.mean([one.factor for one in half]) == pytest.approx(2.0, rel=0.05)
    assert all(one.used.pattern_std / one.used.displacement_std == pytest.approx(3.0) for one in half)
    assert sum(check_noise(e).used == true for e in tests) >= 3


@pytest.mark.slow
def test_a_second_invariant_is_not_taken_for_noise_of_the_pattern():
    tests = [synthetic.with_noise(clean(0.03), Noise(0.01, 3.0, 1e-3), seed) for seed in range(3)]
    found = [check_noise(replace(e, noise=None)).used for e in tests]
    assert not any(one.is_common for one in found)
    assert np.mean([one.displacement_std for one in found]) == pytest.approx(0.01, rel=0.15)


@pytest.mark.slow
def test_a_drift_is_found_in_a_test_that_says_nothing_of_it():
    """Over four seeds: standard deviation, and correlation between neighbours, of a test without time; what is stated with it is kept."""
    tau = -1 / np.log(0.9)
    true = Noise(0.01, 3.0, 1e-3, correlation_time=tau)
    sheet = synthetic.plate_experiment(synthetic.MooneyRivlin(0.15, 0.0), n_increments=8, n_theta=60, n_radial=12)
    tests = [synthetic.with_noise(sheet, true, seed) for seed in range(4)]
    for stated in (None, Noise(0.01, 3.0, 1e-3)):
        found = [check_noise(replace(e, noise=stated)).used for e in tests]
        assert not any(one.is_common for one in found)
        assert np.exp(-1 / np.mean([one.correlation_time for one in found])) == pytest.approx(0.9, abs=0.03)
        assert np.mean([one.displacement_std for one in found]) == pytest.approx(0.01, rel=0.15)
    assert all(check_noise(e).used.correlation_time == tau for e in tests)
