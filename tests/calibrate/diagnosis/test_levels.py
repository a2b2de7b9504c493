"""Levels of tests without a thickness: found from the fitted forces, and no alarm where they differ."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from discoveries import NOISE
from synthetic import ArrudaBoyce, plate_experiment, with_noise

from calibrate import errors
from calibrate.data.load_record import LoadRecord
from calibrate.diagnosis import base_fit
from calibrate.diagnosis.evidence.levels import Level, StiffnessLevel, at_one_level, divided
from calibrate.diagnosis.evidence.own_effects import OwnEffect, own_effects, refined_levels, with_own_effects
from calibrate.diagnosis.evidence.priors import read_priors
from calibrate.diagnosis.problem import all_rows
from calibrate.effects import CATALOGUE

FACTOR = 0.44


@cache
def plates():
    """Two tests of one material, the second a sheet that is 0.44 times as thick; nobody says how thick they are."""
    found = [
        replace(with_noise(plate_experiment(ArrudaBoyce(), n_increments=4), NOISE, seed), thickness=None)
        for seed in (1, 2)
    ]
    return [replace(found[0], name="plate 0"), replace(divided(found[1], 1 / FACTOR), name="plate 1")]


def test_forces_come_to_the_level_of_the_first():
    first, second = plates()
    scaled, levels = at_one_level(plates(), all_rows)
    assert [one.test for one in levels] == ["plate 0", "plate 1"]
    assert levels[0].factor == 1.0
    assert levels[1].factor == pytest.approx(FACTOR, rel=0.01)
    np.testing.assert_array_equal(scaled[0].loaded[0].force, first.loaded[0].force)
    np.testing.assert_allclose(scaled[1].loaded[0].force, second.loaded[0].force / levels[1].factor, rtol=1e-14)


def test_noise_and_machine_record_go_with_the_forces():
    one = plates()[0]
    time = one.time if one.time is not None else np.arange(1.0, one.n_increments + 1)
    record = LoadRecord(time, np.stack([b.force for b in one.loaded]))
    whole = replace(one, time=time, record=record, noise=replace(one.noise, force_std=0.3, force_std_relative=0.01))
    half = divided(whole, 2.0)
    assert (half.noise.force_std, half.noise.force_std_relative) == (0.15, 0.01)
    np.testing.assert_allclose(half.record.force, 0.5 * record.force)
    np.testing.assert_array_equal(half.displacements, whole.displacements)


def test_a_stated_thickness_is_believed():
    stated = [replace(one, thickness=1.0) for one in plates()]
    scaled, levels = at_one_level(stated, all_rows)
    assert levels == ()
    assert scaled == stated
    assert at_one_level(plates()[:1], all_rows)[1] == ()


def test_what_is_held_out_tells_nothing_of_the_level():
    def first_two(system):
        rows = all_rows(system)
        rows[2:] = False
        return rows

    first, second = plates()
    growing = np.where(np.arange(4) < 2, 1.0, 3.0)[:, None]
    spoilt = replace(second, loaded=tuple(replace(b, force=growing * b.force) for b in second.loaded))
    levels = [at_one_level([first, one], first_two)[1][1].factor for one in (second, spoilt)]
    assert levels[0] == levels[1]


def test_forces_against_the_deformation_are_an_error():
    first, second = plates()
    turned = replace(second, loaded=tuple(replace(b, force=-b.force) for b in second.loaded))
    with pytest.raises(errors.ForceSignError):
        at_one_level([first, turned], all_rows)


@pytest.mark.parametrize("left", [0.0, 0.05])
def test_what_is_left_of_a_level_is_of_the_test(left):
    """5 % that a neo-Hookean sheet would not see are told with their stated error, and are nobody else's."""
    scaled, _ = at_one_level(plates(), all_rows)
    tests = [scaled[0], divided(scaled[1], 1 / (1 + left))]
    problem, base = base_fit.prepare(tests, [all_rows, all_rows])
    problem, base = with_own_effects(problem, base, CATALOGUE, read_priors())
    found = own_effects(problem, base, read_priors())
    level = next(one for one in found if isinstance(one.effect, StiffnessLevel))
    assert level.tests == ("plate 1",)
    assert abs(level.values[0][0] - left) < 4 * max(level.deviations[0][0], 0.002)
    assert level.deviations[0][0] < 0.02
    first, second = refined_levels((Level("plate 0", 1.0, 1.0), Level("plate 1", FACTOR, FACTOR)), found)
    assert (first.factor, first.deviation, second.divided_by) == (1.0, 0.0, FACTOR)
    assert second.factor == pytest.approx(FACTOR * (1 + left), abs=4 * max(second.deviation, 0.002))
    assert not any(one.is_there for one in found if one is not level)


def test_a_level_that_no_thickness_explains_is_as_uncertain_as_before():
    """As where the joint fit misses the forces of the first test."""
    one = OwnEffect(StiffnessLevel(), ("b", "c"), 1.0, 0.0, (0.1,), ((0.9,), (0.05,)), ((0.01,), (0.002,)), 3.0)
    found = refined_levels((Level("a", 1.0, 1.0), Level("b", 2.0, 2.0), Level("c", 2.0, 2.0)), (one,))
    assert [level.factor for level in found] == [1.0, 2.0, 2.1]
    assert [level.deviation for level in found] == [0.0, 0.2, 0.004]
