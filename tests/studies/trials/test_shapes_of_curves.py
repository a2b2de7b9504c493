"""Shapes that bend a curve, fitted to sheets solved by finite elements: the stiffening of fibres, and how fast a softened material recovers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrate.diagnosis import base_fit, score_tests, weighted_fit
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.misfit import deviances
from calibrate.diagnosis.selection.candidate_fit import Model, at_best_shape, fitted
from calibrate.diagnosis.selection.rounds import Candidate
from calibrate.diagnosis.selection.thresholds import DEFAULT
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from studies.trials.blind_data import draw, make, record
from studies.trials.blind_solution import clean_experiment
from studies.trials.blind_trial import ForeignNoise
from studies.trials.foreign import foreign

CASES = {
    "one fibre family": ({"k": 0.03}, {"angle": 0.7, "k2": 0.8, "kappa": 0.1}, (0.6, 0.1, 0.0)),
    "Mullins softening": ({"r": 0.4}, {"m": 0.1, "beta": 0.2}, (0.02, 0.1)),
}


def fitted_from(name, amplitudes, shape, start):
    """Fit of an effect of this amplitude and shape, from a tenth of the amplitude and the start of the shape."""
    drawn = next(trial for trial in (draw(seed, name) for seed in range(40)) if trial.specimen == "plate")
    (hidden,) = drawn.effects
    hidden = replace(hidden, amplitudes=amplitudes, shape=shape)
    trial = replace(drawn, effects=(hidden,), stretch=1.5, displacement_std=0.006, force_relative=3e-4)
    effect = next(e for e in CATALOGUE if e.name == name)
    problem, base = base_fit.prepare([record(trial, clean_experiment(trial))], [HoldOut().training])
    (true,) = amplitudes.values()
    _, fit = weighted_fit.fit_with_own_weights(problem, base.c, (Addition(effect, (0.1 * true,), start),))
    return fit


@pytest.mark.slow
@pytest.mark.parametrize("axis", [0.3, 0.3 + np.pi / 2])
def test_two_families_are_found_about_either_of_their_axes(axis: float) -> None:
    """42 degrees from the one axis are 48 from the one across: a fit that starts about that one goes on beyond 45."""
    shape = {"axis": 0.3, "half": 0.74, "k2": 0.0, "kappa": 0.0}
    fit = fitted_from("two fibre families", {"k": 0.02}, shape, (axis, 0.7, 0.1, 0.0))
    (found,) = fit.additions
    assert fit.reduced_chi_square < 1.3
    assert abs(found.amplitudes[0] - 0.02) < max(3 * fit.errors[0][0], 0.0006)
    families = sorted((found.shape[0] + sign * found.shape[1]) % np.pi for sign in (1, -1))
    assert families == pytest.approx(sorted([0.3 + 0.74, (0.3 - 0.74) % np.pi]), abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_amplitude_and_shape_are_found_from_another_start(name: str) -> None:
    """A plate pulled to a nominal stretch of 1.5, its noise 1e-4 of its length; from a tenth of the amplitude."""
    amplitudes, shape, start = CASES[name]
    (true,) = amplitudes.values()
    fit = fitted_from(name, amplitudes, shape, start)
    (found,) = fit.additions
    assert fit.reduced_chi_square < 1.3
    assert abs(found.amplitudes[0] - true) < max(3 * fit.errors[0][0], 0.03 * true)
    assert fit.errors[0][0] < 0.1 * true
    assert found.shape == pytest.approx(tuple(shape.values()), rel=0.15)


@pytest.mark.slow
def test_a_fit_that_may_end_elsewhere_is_started_from_there_too() -> None:
    """Two families of fibres on a plate: from the shape with the highest score the fit ends with half of the true amplitude, at one family."""
    data, label = make(draw(995305, "two fibre families"))
    effect = next(e for e in CATALOGUE if e.name == "two fibre families")
    model = Model(*base_fit.prepare([data], [HoldOut.default(data.n_increments, False).training]))
    grid = score_tests.score(model.problem, model.fit, (effect,))[0]
    assert grid.others
    alone = fitted(model, Candidate(at_best_shape(model, replace(grid, others=()))), DEFAULT)
    both = fitted(model, Candidate(at_best_shape(model, grid)), DEFAULT)
    assert alone.fit is not None
    assert both.fit is not None
    alone_left, both_left = deviances([alone.fit, both.fit])
    assert both_left < alone_left - 20
    assert both.addition is not None
    true = label["effects"][0]["amplitudes"]["k"]
    assert abs(both.addition.amplitudes[0] - true) < 2.5 * both.deviations[0] < 0.2 * true


@pytest.mark.slow
def test_an_inclusion_is_looked_for_on_both_sides_of_a_sheet() -> None:
    """A softer rectangle on the left of a plate: of the circles that are tried a stiffer one on the right has the highest score."""
    drawn = foreign(
        next(trial for trial in (draw(seed, "inclusion") for seed in range(40)) if trial.specimen == "plate")
    )
    shape = {"x": -0.144, "y": -0.181, "radius": 0.248, "e1": 0.316, "e2": 0.156}
    hidden = replace(drawn.effects[0], amplitudes={"a": -0.293}, shape=shape)
    data, _ = make(
        replace(drawn, effects=(hidden,), stretch=1.4, foreign=ForeignNoise(0.0, 1.0), displacement_std=0.004)
    )
    effect = next(e for e in CATALOGUE if e.name == "inclusion")
    model = Model(*base_fit.prepare([data], [HoldOut.default(data.n_increments, False).training]))
    grid = score_tests.score(model.problem, model.fit, (effect,))[0]
    assert grid.shape[0] > 0.2
    found = fitted(model, Candidate(at_best_shape(model, grid)), DEFAULT)
    assert found.addition is not None
    assert found.addition.amplitudes[0] == pytest.approx(-0.293, abs=0.01)
    assert found.addition.shape[0] == pytest.approx(
        -0.144, abs=0.03
    )  # its lower edge is beyond that of the plate, so that y and radius are not told
    assert found.fit is not None
    assert found.fit.reduced_chi_square < 1.5
