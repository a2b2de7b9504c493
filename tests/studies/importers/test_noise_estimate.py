"""Noise estimated from a record: recovers what was put in."""

from __future__ import annotations

import numpy as np
import pytest

from calibrate import errors
from studies.importers.recording import load_cell_noise, noise_estimate
from studies.importers.recording.load_cell_noise import Origin

STD = 0.004


def points(columns: int = 36, rows: int = 32, pitch: float = 0.5):
    x, y = np.meshgrid(np.arange(columns) * pitch, np.arange(rows) * pitch)
    return np.stack([x.ravel(), y.ravel()], axis=1)


def smooth_field(p, frames):
    """A large smooth deformation that grows with time."""
    t = np.linspace(0.0, 1.0, frames)[:, None, None]
    return t * np.stack([0.2 * np.sin(p[:, 0] / 6) * p[:, 1], 0.4 * p[:, 1] + np.cos(p[:, 0] / 5)], axis=-1)


def correlated(p, frames, length, seed):
    """Noise (frames, n, 2) with covariance STD^2 exp(-r^2 / (2 l^2)), by its Cholesky factor."""
    rng = np.random.default_rng(seed)
    if length == 0:
        return STD * rng.standard_normal((frames, len(p), 2))
    distance = np.linalg.norm(p[:, None] - p[None], axis=-1)
    factor = np.linalg.cholesky(np.exp(-0.5 * (distance / length) ** 2) + 1e-9 * np.eye(len(p)))
    white = rng.standard_normal((len(p), 2 * frames))
    return STD * np.moveaxis((factor @ white).reshape(len(p), frames, 2), 1, 0)


@pytest.mark.parametrize("length", [0.0, 0.4, 1.0])
def test_recovers_std_and_correlation_length(length):
    p = points()
    found = noise_estimate.displacement_noise(p, smooth_field(p, 16) + correlated(p, 16, length, 1))
    for estimate in (found.total, found.temporal):
        assert estimate.std == pytest.approx(STD, rel=0.06)
        assert estimate.correlation_length == pytest.approx(length, abs=0.06)


def test_a_picture_that_is_missing_leaves_the_noise_as_it_is():
    """What deforms is a line through the frames, however unevenly they lie on it; fine structure, as of holes, does not become noise."""
    p, t = points(), np.delete(np.linspace(0.0, 1.0, 9), 3)[:, None, None]
    fine = np.stack([np.sin(p[:, 0] * 1.7), np.cos(p[:, 1] * 1.3)], axis=-1)
    found = noise_estimate.displacement_noise(p, t * (20 * fine + 5.0) + correlated(p, 8, 0.4, 6))
    assert found.temporal.std == pytest.approx(STD, rel=0.1)
    assert found.temporal.correlation_length == pytest.approx(0.4, abs=0.1)


def test_persistent_errors_count_in_the_total_only():
    p = points()
    fixed = correlated(p, 1, 0.4, 2) * np.linspace(0.0, 4.0, 20)[:, None, None]
    found = noise_estimate.displacement_noise(p, smooth_field(p, 20) + fixed + 0.1 * correlated(p, 20, 0.0, 3))
    assert found.temporal.std == pytest.approx(0.1 * STD, rel=0.06)
    assert found.total.std == pytest.approx(STD * np.sqrt(np.mean(np.linspace(0, 4, 20) ** 2)), rel=0.1)
    assert found.frame_std[-1] > 2.5 * found.frame_std[5]


def test_vibration_and_frame_timing_are_jitter_not_noise():
    p = points()
    rng = np.random.default_rng(4)
    shake = 0.05 * rng.standard_normal((20, 1, 2)) + 0.002 * rng.standard_normal((20, 1, 1)) * p
    found = noise_estimate.displacement_noise(p, smooth_field(p, 20) + shake + correlated(p, 20, 0.0, 5))
    assert found.temporal.std == pytest.approx(STD, rel=0.06)
    assert found.jitter > 5 * STD


@pytest.mark.parametrize("length", [0.0, 0.7])
def test_a_hole_and_a_load_that_turns_do_not_become_noise(length):
    """Steep at the hole, by a hundred times the noise, and not in proportion to the load."""
    p = points()
    p = p[np.linalg.norm(p - [9, 8], axis=1) > 2.0]
    r = p - [9, 8]
    t = np.concatenate([np.linspace(0.1, 1, 10), np.linspace(0.8, 0.1, 8)])[:, None, None]
    steep = 0.5 * (r / np.linalg.norm(r, axis=1)[:, None]) * (2.0 / np.linalg.norm(r, axis=1)[:, None]) ** (2 + 4 * t)
    pulled = t * np.stack([0.5 * p[:, 0], -0.2 * p[:, 1]], axis=-1) + 0.1 * t**2 * np.sin(p / 5)
    found = noise_estimate.displacement_noise(p, pulled + t * steep + correlated(p, 18, length, 7))
    for estimate in (found.total, found.temporal):
        assert estimate.std == pytest.approx(STD, rel=0.05)
        assert estimate.correlation_length == pytest.approx(
            length, abs=0.05 if length else 0.2
        )  # white numbers are white over less than half a distance


def test_few_frames_give_the_total_alone():
    p = points()
    found = noise_estimate.displacement_noise(p, smooth_field(p, 4) + correlated(p, 4, 0.0, 6))
    assert found.temporal is None
    assert found.total.std == pytest.approx(STD, rel=0.06)
    assert found.to_dict()["temporal"] is None


def test_noise_free_field_gives_next_to_nothing():
    p = points()
    found = noise_estimate.displacement_noise(p, smooth_field(p, 8))
    assert found.total.std < 0.02 * STD
    assert found.temporal.std < 0.02 * STD


def test_local_cubic_is_exact_for_cubics():
    p = points(12, 11)
    operator, inner = noise_estimate.local_residual_operator(p)
    assert np.abs(operator @ (p[:, 0] ** 3 - 2 * p[:, 0] * p[:, 1] ** 2 + 5)).max() < 1e-9
    assert operator.shape == (inner.size, len(p))
    assert inner.size == 8 * 7


def test_too_few_points_are_refused():
    with pytest.raises(errors.ExperimentError, match="too few"):
        noise_estimate.displacement_noise(points(6, 6), np.ones((3, 36, 2)))


def test_nothing_that_moves_is_refused():
    p = points()
    with pytest.raises(errors.ExperimentError, match="nothing moves"):
        noise_estimate.displacement_noise(p, np.zeros((6, len(p), 2)))


def elongation_curve(readings: int, largest: float = 30.0):
    """Time (s) and force (N) of a neo-Hookean strip pulled to a stretch of 1.5 at an even rate."""
    time = np.linspace(0.0, 16.0, readings)
    stretch = 1 + 0.5 * time / 16
    return time, largest * (stretch - stretch**-2)


def test_divided_differences_have_unit_norm_and_no_lower_polynomial():
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.2, 2.0, 40))
    for order in load_cell_noise.ORDERS:
        smooth = load_cell_noise.differences(time, np.polyval(np.arange(1.0, order + 1), time / 10), order)
        assert np.abs(smooth).max() < 1e-9
        unit = np.stack([load_cell_noise.differences(time, one, order) for one in np.eye(40)], axis=1)
        np.testing.assert_allclose(np.linalg.norm(unit, axis=1), 1.0)


def test_noise_of_a_dense_record():
    rng = np.random.default_rng(7)
    time = np.sort(rng.uniform(0, 40, 2000))
    force = 20 * np.sqrt(time / 40) + 0.02 * rng.standard_normal(2000)
    force[[300, 1200]] += 5.0  # two jumps
    found = load_cell_noise.force_noise(time, force)
    assert found.std == pytest.approx(0.02, rel=0.1)
    assert (found.order, found.origin) == (2, Origin.ESTIMATED)


def test_noise_of_few_readings_of_a_curve():
    """Nine readings: second differences would give 0.18 N of curvature. Median over seeds within 15 %."""
    time, curve = elongation_curve(9)
    rng = np.random.default_rng(0)
    found = [load_cell_noise.force_noise(time, curve + 0.05 * rng.standard_normal(9)) for _ in range(300)]
    assert np.median([f.std for f in found]) == pytest.approx(0.05, rel=0.15)


def test_curvature_without_noise_is_an_upper_bound_far_below_it():
    time, curve = elongation_curve(9)
    found = load_cell_noise.force_noise(time, curve)
    assert found.origin == Origin.UPPER_BOUND
    curvature = 1.4826 * np.median(np.abs(load_cell_noise.differences(time, curve, 2)))  # taken for noise: 0.18 N
    assert found.std < 0.02 * curvature


def test_too_few_readings_have_no_noise_to_be_told():
    time, curve = elongation_curve(4)
    assert load_cell_noise.force_noise(time, curve).origin == Origin.UNKNOWN


def test_coarse_digits_are_no_silence():
    """A load cell of 0.01 N with noise of 0.002 N: most neighbouring readings are equal, and the error is that of the digit. Fine digits add nothing."""
    rng, time = np.random.default_rng(0), np.arange(1700) / 50
    force = 0.05 * time + 0.002 * rng.standard_normal(len(time))
    coarse = load_cell_noise.force_noise(time, np.round(force / 0.01) * 0.01)
    assert 0.999 * 0.01 / np.sqrt(12) < coarse.std < 0.006
    assert load_cell_noise.force_noise(time, force).std == pytest.approx(0.002, rel=0.15)
    held = np.minimum(np.arange(200), 10.0)  # without noise, and then without motion
    assert load_cell_noise.force_noise(np.arange(200.0), held).std < 1e-9
