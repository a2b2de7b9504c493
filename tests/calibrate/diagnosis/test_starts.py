"""Where fits of an effect with a shape start: the best shapes of the grid that make different changes, each refined before one is chosen."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibrate.diagnosis import score_tests
from calibrate.diagnosis.score_tests import STARTS, Score, Status
from calibrate.diagnosis.selection.candidate_fit import Model, at_best_shape, at_best_shapes
from calibrate.diagnosis.selection.thresholds import DEFAULT
from calibrate.effects import CATALOGUE

EFFECT = next(one for one in CATALOGUE if one.name == "inclusion")
OTHERS = (0.1, 0.0, 0.0, 0.0, 0.0)


def score(height, angle, x=0.0, admissible=True):
    """Of a shape at x, whose change is at an angle, rad, to others."""
    direction = np.array([np.cos(angle), np.sin(angle)])
    return Score(
        EFFECT, Status.TESTED, score=height, degrees=1, amplitudes=(0.1,), shape=(x, 0.0, *OTHERS), admissible=admissible, direction=direction
    )  # fmt: skip


def test_starts_differ_and_score_half_as_high():
    best = score(100.0, 0.0)
    tested = [
        best,
        score(99.0, 0.3),
        score(70.0, 1.2),
        score(69.0, 1.25),
        score(80.0, 0.8),
        score(49.0, 2.2),
        score(90.0, 2.4, admissible=False),
    ]
    assert [one.score for one in score_tests._others(best, tested)] == [80.0, 70.0]
    assert [one.score for one in score_tests._others(best, [best, *tested[2:4]])] == [70.0]


def test_there_are_no_more_starts_than_allowed():
    directions = np.eye(8)
    tested = [
        Score(EFFECT, Status.TESTED, score=100.0 - i, degrees=1, direction=one) for i, one in enumerate(directions)
    ]
    assert len(score_tests._others(tested[0], tested)) == STARTS


@pytest.fixture
def two_hills(monkeypatch):
    """Scores over x: of the grid the hill on the right is the higher one, its top is not."""

    def examined(problem, state, addition, U, r, hidden=None, correct=True):
        x = addition.shape[0]
        height = 100 * np.exp(-(((x - 0.3) / 0.1) ** 2)) + 140 * np.exp(-(((x + 0.3) / 0.1) ** 2))
        return score(height, 0.0 if x > 0 else 1.5, x), None

    monkeypatch.setattr(score_tests, "examine_shape", examined)
    fit = SimpleNamespace(columns=np.zeros((2, 1)), residual=np.ones(2))
    fit.remembering = lambda: fit
    problem = SimpleNamespace(shapes=lambda effect: [(x, 0.0, *OTHERS) for x in (-0.4, -0.2, 0.0, 0.3)])
    return Model(problem, fit)


def on_grid(height, others=()):
    """As the grid sees the right hill, over a dispersion of 2; the left one as it is."""
    return replace(score(height, 0.0, 0.3), others=others)


def test_the_higher_hill_is_found_from_the_lower_start(two_hills):
    left = score(51.5, 1.5, -0.2)
    found = at_best_shape(two_hills, on_grid(50.0, (left,)))
    assert found.shape[0] == pytest.approx(-0.3, abs=0.03)
    assert found.score == pytest.approx(70.0, rel=0.05)  # over the dispersion, as the first
    assert not found.others  # the other hill is not nearly as high: 50 of 70


def test_without_another_start_it_stays_where_it_is(two_hills):
    found = at_best_shape(two_hills, on_grid(50.0))
    assert (found.shape[0], found.score) == (pytest.approx(0.3, abs=0.03), pytest.approx(50.0))


def test_effects_without_a_shape_take_no_place_of_those_that_are_refined(two_hills):
    plain = [Score(one, Status.TESTED, score=60.0, degrees=1) for one in CATALOGUE if not one.shapes][:6]
    found = at_best_shapes(two_hills, [*plain, on_grid(50.0, (score(51.5, 1.5, -0.2),))], DEFAULT)
    assert len(found) == 7
    assert found[0].effect is EFFECT
