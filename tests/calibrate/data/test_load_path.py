"""Turning points of a test: straight lines need their ends only, what turns needs every turn, and shares interpolate."""

from __future__ import annotations

import numpy as np
import pytest

from calibrate.data.load_path import BEND, STEP, turning_points

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
