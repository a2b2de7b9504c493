"""Noise that the equations see: of data whose noise is known, whatever is stated, and beside an effect that the material lacks."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import synthetic
from scipy import stats

from calibrate.data.experiment import Noise
from calibrate.diagnosis.base_fit import prepare
from calibrate.diagnosis.problem import all_rows
from calibrate.diagnosis.residual_tests import SCALE_ERROR, ChiSquare
from calibrate.fitting.noise import fine_fields, noise_check
from calibrate.fitting.noise.noise_check import NoiseCheck, check_noise, with_checked_noise, with_found_noise

NOISE = Noise(0.01, 3.0, 1e-3)


@cache
def clean(c01, n_radial):
    material = synthetic.MooneyRivlin(0.15, c01)
    return synthetic.plate_experiment(material, n_increments=2, n_theta=5 * n_radial, n_radial=n_radial)


def sheet(seed=1, c01=0.0, n_radial=8):
    return synthetic.with_noise(clean(c01, n_radial), NOISE, seed)


def test_what_is_stated_does_not_change_what_is_found():
    half = replace(NOISE, displacement_std=0.5 * NOISE.displacement_std)
    right, wrong = check_noise(sheet()), check_noise(replace(sheet(), noise=half))
    assert right.found == pytest.approx(NOISE.displacement_std, rel=0.15)
    assert wrong.found == pytest.approx(right.found, rel=0.02)
    assert wrong.used == replace(NOISE, displacement_std=wrong.found) and wrong.corrected


def test_too_few_points_say_nothing_and_what_is_stated_stays(monkeypatch):
    monkeypatch.setattr(fine_fields, "FEWEST", 10**6)
    few = check_noise(sheet())
    assert np.isnan(few.found) and few.used == NOISE and not few.corrected


def test_a_calibration_takes_what_is_found_for_new_in_each_increment(monkeypatch):
    """As large in all; what is stated is taken as it is."""
    parts = Noise(0.004, 3.0, 1e-3, pattern_std=0.01, reference_std=0.002, correlation_time=5.0)
    monkeypatch.setattr(noise_check, "check_noise", lambda e: NoiseCheck(None, parts.total_std, parts))
    found, check = with_found_noise(replace(sheet(), noise=None))
    assert found.noise == Noise(parts.total_std, 3.0, 1e-3) and check.used == found.noise
    stated = sheet()
    assert with_found_noise(stated)[0] is stated and with_found_noise(stated)[1] is None


def test_a_stated_noise_that_agrees_is_kept():
    found = check_noise(sheet()).found
    for factor, kept in ((1.0, True), (0.95, True), (1.2, False)):
        stated = replace(NOISE, displacement_std=factor * found)
        assert (check_noise(replace(sheet(), noise=stated)).used == stated) is kept


@pytest.mark.slow
def test_noise_that_is_not_stated_is_found_as_a_diagnosis_needs_it():
    """Standard deviation and correlation length of a single test make up for each other; what the equations make of both is right."""
    seen = []
    for seed in range(4):
        checked, found = with_checked_noise(replace(sheet(seed, n_radial=12), noise=None))
        assert found.stated is None and checked.noise == found.used
        assert found.found == pytest.approx(NOISE.displacement_std, rel=0.25)
        assert found.used.mean_length == pytest.approx(NOISE.correlation_length, rel=0.3)
        exact, estimated = (prepare([e], [all_rows])[1] for e in (sheet(seed, n_radial=12), checked))
        seen.append(estimated.reduced_chi_square / exact.reduced_chi_square)
    assert np.mean(seen) == pytest.approx(1.0, abs=0.2)
    assert min(seen) > 0.6 and max(seen) < 1.4


@pytest.mark.slow
def test_an_effect_that_the_material_lacks_is_not_taken_for_noise():
    # an energy of I2 as large as that of I1
    missing = sheet(c01=0.15, n_radial=12)
    checked, found = with_checked_noise(missing)
    assert found.found < 2 * NOISE.displacement_std
    assert prepare([checked], [all_rows])[1].unexplained.p_value < 1e-6


def test_a_chi_square_knows_that_the_noise_is_known_to_a_few_percent_only():
    many = 4000
    assert ChiSquare(many * (1 + SCALE_ERROR) ** 2, many).p_value > 0.1  # one standard deviation of the noise
    assert ChiSquare(many * (1 + 4 * SCALE_ERROR) ** 2, many).p_value < 1e-3
    few = 10  # where chance is larger than that, nothing changes
    assert ChiSquare(20.0, few).p_value == pytest.approx(stats.chi2.sf(20.0, few), rel=0.2)


@pytest.mark.slow
def test_over_seeds_the_error_is_a_few_percent():
    found = np.array([check_noise(sheet(seed, n_radial=12)).found for seed in range(12)]) / NOISE.displacement_std
    assert abs(found.mean() - 1) < 0.03
    assert found.std() < SCALE_ERROR  # as the chi-squares take it


def test_no_less_is_new_in_a_picture_than_all_pictures_show():
    """The variance in all stays; what is above the least stays as it is."""
    noise = Noise(1e-4, pattern_std=6e-3, reference_std=3e-3, correlation_time=4.0)
    found = noise_check.with_least_own(noise, 6e-4)
    assert found.displacement_std == 6e-4
    assert found.total_std == pytest.approx(noise.total_std)
    assert found.pattern_std / found.reference_std == pytest.approx(2.0)
    assert noise_check.with_least_own(noise, 5e-5) is noise
    assert noise_check.with_least_own(noise, 1.0) is noise
