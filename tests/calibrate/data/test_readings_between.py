"""Increments between pictures: their displacements, their noise, and which of their equations are used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_sheet import stretched

from calibrate.data.experiment import Experiment, LoadRecord, Noise
from calibrate.data.readings_between import picture_weights, with_readings
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.equations.equilibrium import equilibrium
from calibrate.equations.noise_covariance import between_increments, common_sample, noise_factor

TIME = np.linspace(0, 3, 301)
PICTURES = np.array([0.5, 1.0, 1.5, 2.0, 2.5, 3.0])


def machine(position) -> LoadRecord:
    return LoadRecord(TIME, np.zeros((1, len(TIME), 2)), position)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_a_smooth_function_of_the_crosshead_is_met_also_where_a_ramp_ends_between_two_pictures(degree):
    position = np.minimum(TIME, 2.3)
    times = np.array([0.25, 0.7, 1.9, 2.2, 2.4, 2.8])
    found = picture_weights(machine(position), PICTURES, times) @ np.minimum(PICTURES, 2.3) ** degree
    np.testing.assert_allclose(found, np.minimum(times, 2.3) ** degree, atol=1e-12)


def test_no_polynomial_is_laid_across_a_turn():
    """Up to 1.5 s and back: what differs between the two ways, as after softening, stays where it is."""
    position = np.minimum(TIME, 3 - TIME)
    times = np.array([1.2, 1.7, 2.2])
    W = picture_weights(machine(position), PICTURES, times)
    assert not W[0, 3:].any()
    assert not W[1:, :2].any()


def test_without_a_crosshead_displacements_go_straight():
    W = picture_weights(machine(None), PICTURES, np.array([0.25, 0.75, 1.1]))
    np.testing.assert_allclose(W[:, :3], [[0.5, 0, 0], [0.5, 0.5, 0], [0, 0.8, 0.2]], atol=1e-12)


def sheet_pulled(noise: Noise | None = Noise(1e-3, 0.0, 0.0, 1e-3, 2e-3), crosshead=TIME) -> Experiment:
    """The sheet of `stretched`, pulled in proportion to time, whose grips' forces across the pull were measured, too."""
    pull = np.stack([np.zeros(TIME.shape), TIME], axis=1)
    one = stretched(record=LoadRecord(TIME, np.stack([-pull, pull]), crosshead), noise=noise)
    unit = one.displacements[-1] / 3
    return replace(one, displacements=np.array([1.0, 2.0, 3.0])[:, None, None] * unit)


def test_increments_between_pictures():
    sheet = sheet_pulled()
    found = with_readings(sheet, 2, 0)
    np.testing.assert_allclose(found.time, [0.5, 1, 1.5, 2, 2.5, 3])
    assert found.pictures.tolist() == [1, 3, 5]
    np.testing.assert_allclose(found.displacements, found.time[:, None, None] * sheet.displacements[0], atol=1e-12)
    np.testing.assert_allclose(found.loaded[1].force[:, 1], found.time)
    np.testing.assert_array_equal(found.displacements[found.pictures], sheet.displacements)
    assert found.fingerprint == sheet.fingerprint
    assert found.select(found.pictures).interpolated is None
    assert found.noise.force_std == pytest.approx(1e-3)  # a motion in proportion is interpolated exactly


def test_they_have_no_noise_of_their_own():
    """The covariance over the increments is that of sums of noisy pictures, and has the rank of these."""
    sheet = sheet_pulled()
    found = with_readings(sheet, 3, 0)
    M = between_increments(found, found.noise)
    assert np.linalg.matrix_rank(M, tol=1e-9) == sheet.n_increments
    np.testing.assert_allclose(M[np.ix_(found.pictures, found.pictures)], between_increments(sheet, sheet.noise))
    rng = np.random.default_rng(0)
    root = np.linalg.cholesky(between_increments(sheet, sheet.noise))
    errors = found.interpolated @ root @ rng.standard_normal((3, 40_000))
    np.testing.assert_allclose(np.cov(errors), M, atol=0.05 * M.max())


def test_only_the_loaded_edges_have_equations_between_pictures():
    system = equilibrium(with_readings(sheet_pulled(), 2, 0), 4.0)
    known = np.isfinite(system.loads).reshape(6, 2, -1)
    loaded = system.fields.boundary >= 0
    between = np.array([0, 2, 4])
    assert known[1][:, ~loaded].all() and known[1][1].all()  # a picture
    assert known[between][:, 1, loaded].all()
    assert not known[between][:, 0].any()  # a force across the pull that is nothing but noise
    assert not known[between][:, :, ~loaded].any()


def test_a_reading_is_fitted_where_its_pictures_are():
    found = with_readings(sheet_pulled(crosshead=None), 2, 0)
    fitted = HoldOut.parse("last:0.34").increments(found)
    assert fitted[found.pictures].tolist() == [True, True, False]
    assert fitted.tolist() == [True, True, True, True, False, False]


def test_motion_that_the_pictures_do_not_show_makes_the_force_less_sure():
    sheet = sheet_pulled()
    bent = replace(sheet, displacements=sheet.displacements * np.array([0.9, 1.05, 1.0])[:, None, None])
    assert with_readings(bent, 2, 0).noise.force_std > 10 * with_readings(sheet, 2, 0).noise.force_std


def test_without_a_record_or_noise_there_are_none():
    assert with_readings(replace(sheet_pulled(), record=None), 2, 0).interpolated is None
    unknown = sheet_pulled(noise=None)
    assert with_readings(unknown, 2, 0) is unknown


def test_samples_of_noise_are_the_same_sums_of_pictures():
    found = with_readings(sheet_pulled(), 3, 0)
    M = between_increments(found, found.noise)
    fields = common_sample(noise_factor(found, Noise(1e-3)), np.random.default_rng(0), M)
    summed = np.einsum("tk,kni->tni", found.interpolated, fields[found.pictures])
    np.testing.assert_allclose(fields, summed, atol=1e-6 * np.abs(fields).max())
    assert fields.std() == pytest.approx(1e-3 * np.sqrt(np.trace(M) / len(M)), rel=0.4)
