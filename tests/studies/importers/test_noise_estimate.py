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
    assert found.origin == Origin.MAY_HOLD_CURVATURE
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


def two_rates(p, turns: bool):
    """Fields (k, n, 2) mm of a strip that is stretched in steps of 3 s, then back or on at another rate, bending as it goes."""
    t = np.cumsum([3.0] * 6 + ([-1.75] if turns else [1.75]))[:, None, None] / 18
    return 15 * t * p * [0.05, -0.02] + t**2 * np.sin(p[:, ::-1] / 4) + 0.3 * t**3 * np.cos(p / 3)


@pytest.mark.parametrize("pictures", [5, 6, 7])
@pytest.mark.parametrize("turns", [True, False])
def test_motion_that_few_pictures_do_not_take_off_is_no_noise(pictures, turns):
    """Noise of STD in every picture, of a motion of millimetres that no line between pictures follows."""
    p = points()
    found = noise_estimate.displacement_noise(p, two_rates(p, turns)[:pictures] + correlated(p, pictures, 0.0, 8))
    for estimate in (found.total, found.temporal):
        assert estimate.std == pytest.approx(STD, rel=0.12)
        assert estimate.correlation_length < 0.4


def test_motion_that_half_of_the_components_leave_is_no_noise():
    """Ten pictures whose motion has seven parts."""
    p, rng = points(), np.random.default_rng(9)
    parts = [10.0**-k * np.stack([np.sin((k + 2) * p[:, 0] / 9), np.cos((k + 2) * p[:, 1] / 8)], -1) for k in range(3)]
    parts += [0.02 * np.stack([np.cos((k + 2) * p[:, 1] / 9), np.sin((k + 2) * p[:, 0] / 8)], -1) for k in range(4)]
    frames = np.einsum("kj,jni->kni", rng.standard_normal((10, 7)), np.array(parts))
    found = noise_estimate.displacement_noise(p, frames + correlated(p, 10, 0.0, 10))
    assert found.temporal.std == pytest.approx(STD, rel=0.12)
    assert found.total.std == pytest.approx(STD, rel=0.12)


def test_a_turning_point_is_no_jitter():
    """Between two pictures of the same place the motion is off their line by all of its way."""
    p = points()
    t = np.array([1, 2, 3, 4, 5, 4.5, 4, 3.5, 3.0])[:, None, None] / 5
    found = noise_estimate.displacement_noise(p, 2.0 * t * p + correlated(p, 9, 0.0, 11))
    assert found.jitter < STD


def cycles(unloading: float = 0.9):
    """Time (s), elongation (mm) and force (N) of two cycles in eleven pictures, at three rates; the way back is softer by `unloading`, with the loop closed at the lower turning point."""
    time = np.array([0, 2.7, 5.3, 8, 9.7, 11.3, 16.2, 21.1, 26, 29, 32])
    length = np.array([0, 3.8, 7.6, 11.4, 6.7, 1.9, 8.9, 15.8, 22.6, 14.2, 5.7])
    back = np.array([1, 1, 1, 1, unloading, 1, 1, 1, 1, unloading, unloading])
    return time, length, 40 * back * (1 - np.exp(-length / 40))


def test_turning_points_of_cycles_are_no_noise():
    time, length, curve = cycles()
    rng = np.random.default_rng(0)
    found = [load_cell_noise.force_noise(time, curve + 0.006 * rng.standard_normal(11), length) for _ in range(300)]
    assert np.median([f.std for f in found]) < 0.06  # its third differences; across the turning points 1 N
    assert np.mean([f.origin == Origin.MAY_HOLD_CURVATURE and f.most > 0.006 for f in found]) > 0.95
    # the turns of the force alone; times are rounded to 0.1 s, 2 % of a step
    without = load_cell_noise.force_noise(time, curve)
    assert without.std < 0.2 and without.origin == Origin.MAY_HOLD_CURVATURE


def test_a_dense_record_of_cycles_has_its_own_noise():
    time = np.linspace(0, 32, 3201)
    force = np.interp(time, *cycles(1.0)[::2]) + 0.006 * np.random.default_rng(1).standard_normal(len(time))
    assert load_cell_noise.force_noise(time, force).std == pytest.approx(0.006, rel=0.1)


def test_a_rate_that_changes_bends_no_force_over_the_elongation():
    rng, time = np.random.default_rng(2), np.arange(12.0)
    length = np.array([0, 2, 4, 6, 6.5, 7, 9, 11, 11.5, 12, 14, 16.0])
    curve = 20 * (1 - np.exp(-length / 30))
    found = [load_cell_noise.force_noise(time, curve + 0.01 * rng.standard_normal(12), length).std for _ in range(200)]
    assert np.median(found) == pytest.approx(0.01, rel=0.35)
    assert load_cell_noise.force_noise(time, curve).std > 0.04  # over the time


def test_a_held_load_that_goes_to_and_fro_is_noise():
    """Its turns are noise, every second one; none is left out."""
    force = 5.0 + 0.02 * np.random.default_rng(3).standard_normal(400)
    assert load_cell_noise.force_noise(np.arange(400.0), force).std == pytest.approx(0.02, rel=0.15)


@pytest.mark.parametrize("std", [0.006, 0.05])
def test_an_upper_bound_is_seldom_too_low(std):
    time, curve = elongation_curve(9)
    rng = np.random.default_rng(4)
    found = [load_cell_noise.force_noise(time, curve + std * rng.standard_normal(9)) for _ in range(400)]
    assert np.mean([f.may_hold_curvature and f.most < std for f in found]) < 0.07
