"""Times between pictures: evenly, and more of them where the force of the record bends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from small_sheet import stretched

from calibrate.data.experiment import LoadRecord, Noise
from calibrate.data.reading_times import reading_times

TIME = np.linspace(0, 3, 301)


def sheet_with(force, noise: float = 0.0, crosshead=None):
    pull = np.stack([np.full(TIME.shape, np.nan), force], axis=1)
    return stretched(record=LoadRecord(TIME, np.stack([-pull, pull]), crosshead), noise=Noise(1e-3, 0.0, 0.0, noise))


def test_straight_forces_are_divided_evenly():
    np.testing.assert_allclose(reading_times(sheet_with(TIME), 2, 50), [0.5, 1.5, 2.5])
    assert reading_times(sheet_with(TIME), 1, 50).size == 0
    assert reading_times(replace(stretched(), record=None), 3, 50).size == 0


def relaxing(tau: float):
    """A hold from 1.2 s on."""
    return np.where(TIME < 1.2, TIME, 0.6 + 0.6 * np.exp(-(TIME - 1.2) / tau))


def test_times_are_dense_where_a_force_relaxes():
    force = relaxing(0.15)
    times = reading_times(sheet_with(force), 1, 50)
    assert np.abs(times - 1.2).min() < 0.011  # the corner itself
    assert ((times > 1.2) & (times < 1.7)).sum() >= 4
    assert not (times < 1.15).any()
    knots = np.sort(np.concatenate([[0, 1, 2, 3], times]))
    assert np.abs(np.interp(TIME, knots, np.interp(knots, TIME, force)) - force).max() <= 2e-3 * 1.2 + 1e-12


def test_noise_is_not_followed():
    """Independent errors of a straight force are almost never 4 standard deviations of a reading off it."""
    found = [
        len(
            reading_times(
                sheet_with(TIME + 0.01 * np.random.default_rng(seed).standard_normal(TIME.shape), 0.01), 1, 50
            )
        )
        for seed in range(20)
    ]
    assert np.mean(found) < 1


def test_a_corner_of_the_crosshead_alone_is_found_and_the_number_is_bounded():
    crosshead = np.minimum(TIME, 1.4)
    times = reading_times(sheet_with(TIME, crosshead=crosshead), 1, 50)
    assert np.abs(times - 1.4).min() < 0.03
    assert len(reading_times(sheet_with(relaxing(0.15)), 1, 3)) <= 3
