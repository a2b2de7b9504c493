"""Turning points of a test: straight lines need their ends only, what turns needs every turn, and shares interpolate."""

from __future__ import annotations

import numpy as np
import pytest

from calibrate.data.load_path import BEND, LINE, STEP, samples, turning_points

SHAPE = np.random.default_rng(0).standard_normal((2, 30, 2))


def proportional(factors):
    return np.asarray(factors)[:, None, None] * SHAPE[0]


def test_a_ramp_needs_a_step_of_a_quarter_and_is_interpolated_exactly():
    factors = np.arange(1, 21) / 20
    chosen, shares = turning_points(proportional(factors))
    assert chosen.tolist() == [4, 9, 14, 19]
    np.testing.assert_allclose(shares @ factors[chosen], factors, atol=1e-12)
    square = factors**2
    assert np.abs(shares @ square[chosen] - square).max() <= STEP**2 / 4 + 1e-12


def test_every_turn_is_chosen():
    factors = np.array([0.1, 0.2, 0.1, 0.05, 0.2, 0.5, 1.0, 0.9, 0.95])
    chosen, shares = turning_points(proportional(factors))
    assert {1, 3, 6, 7} <= set(chosen.tolist())
    np.testing.assert_allclose(shares @ factors[chosen], factors, atol=2 * BEND)


def test_a_pull_in_another_direction_is_no_straight_line():
    one, other = np.minimum(np.arange(1, 9) / 4, 1), np.maximum(np.arange(1, 9) / 4 - 1, 0)
    u = one[:, None, None] * SHAPE[0] + 0.2 * other[:, None, None] * SHAPE[1]
    chosen, shares = turning_points(u)
    assert 3 in chosen
    np.testing.assert_allclose(np.einsum("tk,knd->tnd", shares, u[chosen]), u, atol=BEND * np.abs(u).max() * 3)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_few_increments_are_all_chosen(count):
    chosen, shares = turning_points(proportional(np.arange(1, count + 1) / count))
    assert chosen.tolist() == list(range(count))
    np.testing.assert_array_equal(shares, np.eye(count))


def test_samples_interpolate_what_is_not_nothing_at_rest():
    """A tangent that falls with the load: exact at the samples, of third order in their distance between."""
    factors = np.arange(1, 42) / 41
    chosen, shares = samples(proportional(factors))
    assert chosen[0] == 0 and chosen[-1] == 40 and len(chosen) == 7
    np.testing.assert_allclose(shares.sum(axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(shares[chosen], np.eye(len(chosen)), atol=1e-12)
    np.testing.assert_allclose(shares @ factors[chosen] ** 2, factors**2, atol=1e-12)
    tangent = 1 + 3 / (1 + factors) ** 4
    third = 360 / (1 + factors[0]) ** 7
    assert np.abs(shares @ tangent[chosen] - tangent).max() <= third * (LINE / 2) ** 3 / (9 * np.sqrt(3))


@pytest.mark.parametrize(("top", "most"), [(1.5, 0.003), (2.0, 0.01), (3.0, 0.035)])
def test_samples_follow_the_tangent_of_rubber(top, most):
    """What noise of the stretches does to the force of a neo-Hookean strip, which changes fastest at small strain, in 26 increments."""
    x = np.linspace(1, top, 27)[1:]
    chosen, shares = samples(proportional(x - 1))
    slope = np.hypot(1 + 3 / x**3, 2 / x**1.5)
    assert len(chosen) == 7 and np.abs(shares @ slope[chosen] / slope - 1).max() < most


def test_samples_between_which_a_test_jumps_are_joined_by_straight_lines():
    """The increments of a line are all near its ends, so that a parabola through one of them would run away in the middle."""
    factors = np.array([0.1, 0.12, 0.38, 0.4, 0.7, 1.0])
    chosen, shares = samples(proportional(factors))
    assert {0, 3} <= set(chosen.tolist()) and not {1, 2} & set(chosen.tolist())
    assert shares.min() >= -0.13 and shares.max() <= 1
    np.testing.assert_allclose(shares @ factors[chosen], factors, atol=1e-12)


def test_samples_hold_every_turn():
    factors = np.array([0.1, 0.3, 0.5, 0.7, 0.9, 0.6, 0.3, 0.1, 0.5, 0.8, 1.0])
    chosen, shares = samples(proportional(factors))
    assert {0, 4, 7, 10} <= set(chosen.tolist())
    np.testing.assert_allclose(shares @ factors[chosen] ** 2, factors**2, atol=1e-12)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_of_few_increments_all_are_samples(count):
    chosen, shares = samples(proportional(np.arange(1, count + 1) / count))
    assert chosen.tolist() == list(range(count))
    np.testing.assert_array_equal(shares, np.eye(count))
