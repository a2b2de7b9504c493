"""What increments have in common of the noise: of numbers drawn with known variances, and of simulated tests."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import synthetic

from calibrate.data.experiment import Noise
from calibrate.fitting.common_noise import CommonRatios, common_ratios
from calibrate.fitting.noise_check import check_noise

SHARES = np.array([0.2, 0.5, 0.75, 1.0])


def drawn(pattern, reference, seed, n=800, outliers=0):
    """y (n, k) and correlations (n, k, k) that differ from field to field."""
    rng = np.random.default_rng(seed)
    directions = np.array([1.0, 0.0, 0.0]) + 0.25 * rng.standard_normal((n, 4, 3))
    directions /= np.linalg.norm(directions, axis=2)[:, :, None]
    R = directions @ directions.transpose(0, 2, 1)
    covariance = np.eye(4) + pattern * np.outer(SHARES, SHARES) + reference
    root = np.linalg.cholesky(covariance * R + 1e-12 * np.eye(4))
    y = 0.01 * (root @ rng.standard_normal((n, 4, 1)))[:, :, 0]
    y[:outliers] += 2.0 * SHARES
    return y, R


@pytest.mark.parametrize(("pattern", "reference"), [(4.0, 0.5), (0.0, 1.0), (19.0, 19.0)])
def test_variances_are_found(pattern, reference):
    found = np.mean([common_ratios(*drawn(pattern, reference, seed, outliers=30), SHARES) for seed in range(3)], axis=0)
    whole = 1 + pattern + reference
    np.testing.assert_allclose(found, [pattern, reference], atol=0.1 * whole)


def test_none_are_found_where_increments_are_independent():
    found = [common_ratios(*drawn(0.0, 0.0, seed), SHARES) for seed in range(3)]
    assert all(one == CommonRatios() for one in found)
    y, R = drawn(4.0, 4.0, 0)
    assert common_ratios(y[:, :1], R[:, :1, :1], SHARES[:1]) == CommonRatios()


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
