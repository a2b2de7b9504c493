"""Readings that are wrong or lost in single frames: found and replaced in a field that is known, and steps that stay left alone."""

import numpy as np
import pytest

from studies.importers.masking.single_readings import bridged

X, Y = (v.ravel() for v in np.meshgrid(np.arange(0.0, 40.0, 2.0), np.arange(0.0, 20.0, 2.0)))
POINTS = np.column_stack([X, Y])
FRAMES, NOISE = 21, 0.004


def load() -> np.ndarray:
    """Up and down, with a sharp turn."""
    return np.concatenate([np.linspace(0, 1, 11), np.linspace(0.9, 0.0, 10)])


def field() -> np.ndarray:
    """(t, n, 2), mm: a hole's worth of curvature, and no noise."""
    shape = np.column_stack([0.2 * X + 0.004 * X**2, -0.05 * Y + 0.05 * np.sin(X / 6) * Y / 10])
    return load()[:, None, None] * shape


def noisy() -> np.ndarray:
    u = field() + NOISE * np.random.default_rng(0).standard_normal((FRAMES, len(POINTS), 2))
    u[0] = 0.0
    return u


def planted(share: float, size: float, lost: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values; wrong readings and failed ones (t, n), none in the first and last frame."""
    u, rng = noisy(), np.random.default_rng(1)
    inner = np.zeros(u.shape[:2], bool)
    inner[1:-1] = True
    wrong = (rng.random(u.shape[:2]) < share) & inner
    failed = (rng.random(u.shape[:2]) < lost) & inner & ~wrong
    turn = rng.uniform(0, 2 * np.pi, wrong.sum())
    u[wrong] += size * np.column_stack([np.cos(turn), np.sin(turn)])
    u[failed] = np.nan
    return u, wrong, failed


def test_what_is_good_stays_as_it_is():
    """Also at the turn, where all paths bend."""
    u = noisy()
    found = bridged(POINTS, u)
    assert not found.replaced.any()
    np.testing.assert_array_equal(found.values, u)


@pytest.mark.parametrize("share", [0.01, 0.04])
def test_single_readings_are_found_and_replaced_to_their_noise(share):
    """30 standard deviations off, and lost ones beside them; of many at once some are missed, as two in a row are, and left to the test of points."""
    u, wrong, failed = planted(share, 30 * NOISE, share)
    found = bridged(POINTS, u)
    bad = wrong | failed
    assert (found.replaced & ~bad).sum() <= 0.02 * bad.sum()
    assert (bad & ~found.replaced).sum() <= 3 * share * bad.sum()
    errors = (found.values - field())[found.replaced]
    assert np.sqrt((errors**2).mean()) < 3 * NOISE
    untouched = ~found.replaced & ~failed
    np.testing.assert_array_equal(found.values[untouched], u[untouched])


@pytest.mark.parametrize("step", [0.09, 0.1, 0.12, 0.3])
def test_a_step_that_stays_is_no_wrong_reading(step):
    """As of a crack or a slip; nor is a point that is wrong in half of the frames, which is left to the test of points."""
    u = noisy()
    u[8:, 45] += step
    u[::2, 110] += 0.3
    assert not bridged(POINTS, u).replaced[:, [45, 110]].any()


def test_what_fails_to_the_end_stays_failed():
    u = noisy()
    u[17:, 60] = np.nan
    u[5:7, 80] = np.nan
    found = bridged(POINTS, u)
    assert np.isnan(found.values[17:, 60]).all()
    assert found.replaced[5:7, 80].all() and found.replaced.sum() == 2
    assert found.to_dict() == {"readings": 2, "points": 1, "most_in_a_frame": 1}


def test_frames_that_failed_support_nothing():
    """Half of the points are lost in one: it stays, and wrong readings beside it are found all the same."""
    u = noisy()
    u[9, ::2] = np.nan
    u[10, 33] += 0.2
    found = bridged(POINTS, u)
    assert not found.replaced[9].any() and found.replaced[10, 33] and found.replaced.sum() == 1
    assert np.abs(found.values[10, 33] - field()[10, 33]).max() < 5 * NOISE


def test_those_that_are_to_be_kept_are_kept():
    u, wrong, failed = planted(0.01, 30 * NOISE, 0.01)
    found = bridged(POINTS, u, looks=False)
    assert not (found.replaced & wrong).any() and found.replaced[failed].mean() > 0.9


def test_more_columns_are_replaced_with_the_displacements():
    """Heights of stereo data."""
    u = noisy()
    height = 0.1 * load()[:, None, None] * np.ones((1, len(POINTS), 1))
    values = np.concatenate([u, height], axis=2)
    values[6, 50] = np.nan
    found = bridged(POINTS, values)
    assert found.values[6, 50, 2] == pytest.approx(height[6, 50, 0], abs=1e-9)


def test_beside_a_hole_a_turn_of_the_load_is_no_wrong_reading():
    """Though noise of hardly any size leaves the bend of a steep field alone; a match that is wrong there is found all the same."""
    x, y = (v.ravel() for v in np.meshgrid(np.arange(-20.0, 21.0, 2.0), np.arange(-20.0, 21.0, 2.0)))
    points = np.column_stack([x, y])
    points = points[np.linalg.norm(points, axis=1) > 6]
    r = np.linalg.norm(points, axis=1)
    shape = points * [0.3, -0.1] + 8.0 * points / r[:, None] ** 2
    u = load()[:, None, None] * shape + 2e-4 * np.random.default_rng(1).standard_normal((FRAMES, len(points), 2))
    u[0] = 0.0
    assert not bridged(points, u).replaced.any()
    beside = int(r.argmin())
    u[10, beside] += 1.0
    found = bridged(points, u)
    assert found.replaced[10, beside] and found.replaced.sum() == 1
