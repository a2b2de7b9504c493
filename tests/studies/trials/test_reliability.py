"""Reliability of probabilities over trials that were made up with it."""

from __future__ import annotations

import numpy as np
import pytest
from judged_trials import trial

from calibrate.effects import CATALOGUE
from studies.trials.judgement import judge
from studies.trials.reliability import Replaced, reliability, replaced

NAMES = [effect.name for effect in CATALOGUE]


@pytest.mark.parametrize("boast", [False, True])
def test_calibrated_probabilities_are_on_the_diagonal_and_boasted_ones_are_not(tmp_path, boast):
    rng = np.random.default_rng(0)
    trials = []
    for i in range(300):
        p = rng.uniform(0.3, 0.7)
        hidden = [NAMES[0]] if rng.uniform() < p else []
        trials.append(judge(trial(tmp_path, f"t{i}", hidden, probabilities={NAMES[0]: 0.97 if boast else p})))
    found = [one for one in reliability(trials) if one.low > 0]
    assert sum(one.effects for one in found) == 300
    for one in found:
        spread = 4 * np.sqrt(one.mean * (1 - one.mean) / one.effects)
        assert (abs(one.there / one.effects - one.mean) < spread) is not boast


def test_an_effect_without_a_probability_has_zero_and_a_trial_without_any_is_left_out(tmp_path):
    told = judge(trial(tmp_path, "told", [NAMES[0]], probabilities={NAMES[1]: 0.8}))
    untold = judge(trial(tmp_path, "untold", [NAMES[0]], probabilities={}))
    low, high = reliability([told, untold])
    assert (low.effects, low.there, low.mean) == (len(NAMES) - 1, 1, 0.0)
    assert (high.low, high.effects, high.there) == (0.75, 1, 0)
    assert reliability([untold]) == ()


def test_names_that_are_as_right_as_the_hidden_one_count_as_it(tmp_path):
    """Together they have the probability of one or the other, which is no sum where both may be in one explanation."""
    found, hidden = {"stiffness field": 0.6, "inclusion": 0.35}, ["stiffness field"]
    both = {"stiffness field": 0.7, "viscoelasticity": 0.9}
    assert judge(trial(tmp_path, "field", hidden, probabilities=found, together=both)).probabilities == {
        "stiffness field": 0.7
    }
    assert judge(trial(tmp_path, "older", hidden, probabilities=found)).probabilities == {"stiffness field": 0.6}


def test_what_took_the_place_of_other_effects_is_better_or_worse_by_what_was_hidden(tmp_path):
    trials = [
        judge(trial(tmp_path, "better", ["lag"], ["lag"], replaced=["force offset"])),
        judge(trial(tmp_path, "worse", ["lag"], ["force offset"], replaced=["lag"])),
        judge(trial(tmp_path, "same", ["lag"], ["lag", "friction"], replaced=["lag"])),
        judge(trial(tmp_path, "null", [], ["lag"], replaced=["friction"])),
        judge(trial(tmp_path, "kept", ["lag"], ["lag"])),
    ]
    assert replaced(trials) == Replaced(3, 1, 1)
