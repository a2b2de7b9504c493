"""Level, bands and rule of a replay, on rows that were never replayed: closed forms and statistics."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from made_up_replay import FORCE_STD, INCREMENTS, check, observations, only_held

from calibrate.diagnosis.replayed import updating
from calibrate.diagnosis.replayed.band import ALTERNATIVES, BEYOND, FORMULA, NOISE, Alternative, band_of, discretisation
from calibrate.diagnosis.replayed.checked_replay import NoReplayCheck, replay_record
from calibrate.diagnosis.replayed.observations import Observations, ReplayErrors, level_of
from calibrate.diagnosis.replayed.replay_rule import LEVEL, is_rival, is_worse, judge
from calibrate.effects.effect import FORMULA_ERROR


def draws(count: int = 400):
    rng = np.random.default_rng(0)
    return rng.standard_normal((count, len(observations().test)))


def test_the_level_is_the_weighted_mean_and_as_uncertain_as_it_scatters():
    """F measured = s F replayed with equal noise: s = sum F f / sum f^2, of variance sigma^2 / sum f^2."""
    found = level_of(observations(stiffness=1.07))
    assert found.factor == pytest.approx(1 / 1.07)
    factors = [level_of(observations(e)).factor for e in draws()]
    forces = observations().replayed[observations().is_force & ~observations().held]
    assert np.std(factors) == pytest.approx(FORCE_STD / np.linalg.norm(forces), rel=0.1)
    assert np.mean(factors) == pytest.approx(1.0, abs=4 * np.std(factors) / 20)


def test_nothing_that_is_held_out_changes_the_level():
    assert level_of(observations(only_held(50.0))).factor == level_of(observations()).factor


def test_a_right_model_is_within_its_band_as_often_as_stated():
    """The level is fitted in every draw: its error in common to all forces is in the covariance of what is left."""
    squares, outside = [], []
    for errors in draws():
        judgement = check(observations(errors)).judgement
        squares.append(judgement.force.value)
        outside.append(judgement.outside)
    degrees = check(observations()).judgement.force.degrees
    assert np.mean(squares) == pytest.approx(degrees, abs=4 * np.sqrt(2 * degrees / len(squares)))
    assert np.mean(outside) < LEVEL + 3 * np.sqrt(LEVEL / len(outside))


def test_the_level_moves_forces_alone():
    """Errors of fields are what they were; of a force of weight w it takes the share w f away."""
    rows = observations()
    level = level_of(rows)
    moved = level.error_map(rows)
    fields = ~rows.is_force
    np.testing.assert_array_equal(moved[fields], np.eye(len(rows.test))[fields])
    assert (
        np.abs(moved @ np.where(rows.is_force, rows.replayed, 0.0)).max() < 1e-12
    )  # an error of the level alone is gone


def test_parameters_that_scatter_are_in_the_band():
    rng, found = np.random.default_rng(1), []
    own = check(observations(), parameters=0.02)
    change = 0.02 * own.final.rows.replayed * np.linspace(0.5, 1.5, len(own.final.rows.test))
    deviation = np.sqrt(np.diag(observations().noise))
    for errors in draws(200):
        wrong = errors + rng.standard_normal() * change / deviation
        rows = observations(wrong)
        level = level_of(rows)
        found.append(judge(rows, rows.scaled(level.factor), own.band.covariance).force.value)
    assert np.mean(found) == pytest.approx(2, abs=4 * np.sqrt(4 / 200))


def test_what_is_off_by_more_than_its_band_is_outside():
    assert not check(observations(only_held(1.0))).judgement.outside
    assert check(observations(only_held(8.0))).judgement.outside
    assert not check(
        observations(only_held(8.0)), beyond=1.0
    ).judgement.outside  # beyond what was fitted the band is open


def test_a_model_that_predicts_worse_than_the_base_is_worse_though_its_band_is_wide():
    wrong, right = observations(only_held(20.0)), observations()
    found = check(wrong, right, beyond=10.0)
    assert not found.judgement.outside
    assert found.judgement.worse and found.judgement.speaks_against
    assert not check(right, wrong).judgement.worse


@pytest.mark.parametrize("apart", [0.3, 1.0, 3.0])
def test_a_right_model_is_hardly_ever_called_worse_than_one_that_is_wrong_by(apart):
    """In one of a hundred draws of noise, or fewer."""
    wrong = only_held(apart)
    judged = observations().judged
    worse = [is_worse(observations(e + wrong), observations(e), judged) for e in draws()]
    assert np.mean(worse) < 0.01 + 3 * np.sqrt(0.01 / len(worse))
    assert not is_worse(observations(), observations(), judged)


def test_errors_of_the_mesh_that_both_replays_have_make_no_right_model_worse():
    """The base is wrong by one deviation of these errors, beside which the noise is nothing; by noise alone one of ten right models would be worse."""
    clean = observations()
    quiet = replace(clean, noise=clean.noise * 1e-6)
    mesh = np.sqrt(np.diag(discretisation(quiet)))
    wrong = np.where(clean.held, mesh, 0.0)
    worse, rises = [], []
    for errors in draws():
        final = replace(quiet, measured=quiet.replayed + errors * mesh)
        base = replace(final, measured=final.measured + wrong)
        worse.append(is_worse(base, final, clean.judged))
        rise = (final.residual**2 - base.residual**2) / np.diag(quiet.noise)
        rises.append(rise[clean.judged].sum() > 0)
    assert np.mean(worse) < 0.01 + 3 * np.sqrt(0.01 / len(worse))
    assert np.mean(rises) > 0.05


def test_a_test_that_has_something_for_itself_judges_no_model_of_all():
    """Of two tests the second is far off, as one with a gradient that the model of both does not have."""
    off = observations(only_held(20.0))
    second = replace(off, test=off.test + 1)
    both = check(observations()).final.rows
    covariance = check(observations()).band.covariance
    assert judge(both, second, covariance).speaks_against
    assert not judge(both, replace(second, judges=second.test != 1), covariance).speaks_against
    assert judge(both, replace(second, judges=second.test != 0), covariance).speaks_against
    assert judge(both, replace(second, judges=second.test > 1), covariance).p_value == 1.0


def two_tests(first: Observations, second: Observations) -> Observations:
    """One after the other."""
    return replace(
        first,
        test=np.concatenate([first.test, second.test + 1]),
        **{key: np.concatenate([getattr(first, key), getattr(second, key)]) for key in ("increment", "held", "is_force", "measured", "replayed")},
        noise=np.diag(np.tile(np.diag(first.noise), 2)),
        labels=2 * first.labels,
        squares=np.tile(first.squares, (2, 1)),
        points=np.tile(first.points, 2),
    )  # fmt: skip


def test_a_band_beyond_what_was_fitted_opens_for_each_test_by_itself():
    """The second of two is held out, and twice as far: what it does not know is no doubt about the first, of the same increments."""
    first = replace(observations(), held=np.zeros(len(observations().held), bool))
    second = replace(first, held=~first.held)
    rows = two_tests(first, second)
    beyond = np.where(rows.held, 1.0, 0.0)
    band = band_of(rows, rows, level_of(rows), np.zeros((len(beyond), 0)), (), beyond)
    opened = np.sqrt(np.diag(band.parts[BEYOND]))
    assert not opened[~rows.held].any()
    forces = rows.held & rows.is_force
    assert opened[forces] == pytest.approx(FORMULA_ERROR * rows.replayed[forces])


def test_where_all_points_are_prescribed_no_displacement_is_missed():
    rows = replace(observations(only_held(1.0)), squares=np.zeros((1, INCREMENTS)), points=np.array([0]))
    assert ReplayErrors.of(rows, rows.judged).field == 0.0 and ReplayErrors.of(rows, rows.judged).force > 0


def test_a_test_that_has_something_for_itself_sets_no_level():
    """The second of two tests is softer by 20 %, as one with a soft half: the level is that of the first, whose errors are told, and whose forces alone update a model."""
    first, second = observations(), observations(stiffness=1.2)
    rows = two_tests(first, second)
    own = replace(rows, judges=rows.test == 0)
    assert updating.covariance(own).shape == updating.covariance(first).shape != updating.covariance(rows).shape
    assert level_of(rows).factor < 0.95
    assert level_of(own).factor == level_of(first).factor
    assert ReplayErrors.of(rows, rows.judged).force > 0.05
    assert ReplayErrors.of(own, own.judged).force == 0.0
    assert own.judged.sum() == first.judged.sum()


def test_without_a_known_noise_there_is_no_band_to_leave():
    """And worse is what has the larger force error."""
    wrong, right = observations(only_held(30.0)), observations()
    unknown = judge(right, wrong, right.noise, noise_is_known=False)
    assert not unknown.outside and unknown.worse
    assert not judge(wrong, right, right.noise, noise_is_known=False).speaks_against


def test_the_band_of_a_formula_is_two_per_cent_of_its_effect():
    base, final = observations(only_held(100.0)), observations()
    level = level_of(final)
    band = band_of(final, base, level, np.zeros((len(final.test), 0)), (), np.zeros(len(final.test)))
    held = final.held & final.is_force
    own = np.sqrt(np.diag(band.parts[FORMULA]))[held]
    change = 100 * FORCE_STD
    # half of the variance along the change, half as large as its mean square over the six increments
    assert own == pytest.approx(0.02 * change * np.sqrt(0.5 + 0.5 * 2 / INCREMENTS), rel=0.05)


def test_alternatives_open_the_band_by_their_probability():
    """Half and half: the variance between is that of a coin, d^2 / 2 about one of both."""
    final, other = observations(), observations(only_held(10.0))
    level, none = level_of(final), np.zeros(len(final.test))
    given = final, final, level, np.zeros((len(none), 0))
    plain = band_of(*given, (), none)
    wide = band_of(*given, (Alternative(("lag",), 0.5, other),), none)
    held = final.held & final.is_force
    growth = np.diag(wide.covariance - plain.covariance)[held]
    assert growth == pytest.approx((10 * FORCE_STD) ** 2 / 2)
    assert not plain.parts[BEYOND].any() and plain.parts[NOISE].any()


def test_what_makes_most_of_a_band_is_known():
    """Of two competing explanations the one whose probability times the square of its difference is larger; nothing where no part is more than half."""
    final, lag, set_ = observations(), observations(only_held(10.0)), observations(only_held(3.0))
    level, held = level_of(final), final.held & final.is_force
    given = final, final, level, np.zeros((len(held), 0))
    both = (Alternative(("permanent set",), 0.6, set_), Alternative(("lag",), 0.3, lag))
    assert band_of(*given, both, np.zeros(len(held))).largest_part(held) == (ALTERNATIVES, ("lag",))
    assert band_of(*given, (), np.zeros(len(held))).largest_part(held) == (NOISE, ())
    beyond = band_of(*given, (), np.where(final.held, 1.0, 0.0))
    assert beyond.largest_part(held) == (BEYOND, ()) and beyond.largest_part(final.is_force & ~final.held) == (
        NOISE,
        (),
    )
    equal = band_of(*given, both[:1], np.zeros(len(held)))
    noise = np.diag(equal.parts[NOISE])[held].sum() / np.diag(equal.parts[ALTERNATIVES])[held].sum()
    equal.parts[ALTERNATIVES][:] *= noise
    assert equal.largest_part(held) is None


def test_what_misses_the_fitted_pictures_by_far_is_no_rival():
    """Forces of a rival may be off by 4 %, or twice as much as the final model's; displacements by twice as much; what was held out judges none."""
    final = observations()
    forces, fitted = np.where(final.is_force, final.measured, 0.0), ~final.held

    def off(share, where, like=final):
        return replace(like, replayed=like.measured - share * np.where(where, forces, 0.0))

    assert is_rival(off(0.039, fitted), final) and not is_rival(off(0.041, fitted), final)
    assert is_rival(off(0.5, final.held), final)
    assert is_rival(off(0.19, fitted), off(0.1, fitted)) and not is_rival(off(0.21, fitted), off(0.1, fitted))
    assert is_rival(replace(final, squares=3.9 * final.squares), final)
    assert not is_rival(replace(final, squares=4.1 * final.squares), final)


def test_levels_that_differ_by_their_uncertainty_do_not_disagree():
    assert check(observations(stiffness=1.07)).final.levels_disagree
    assert not check(observations(stiffness=1.003)).final.levels_disagree  # less than the error of a load cell
    assert not check(observations(stiffness=1.07), parameters=0.1).final.levels_disagree


def test_where_no_force_is_known_fields_judge_alone():
    """As of a section that carries an unknown part of the forces: no level, no force error."""
    rows = observations()
    fields = replace(rows, is_force=np.zeros(len(rows.test), bool))
    found = check(fields)
    assert (found.final.level.factor, found.final.level.deviation) == (1.0, 0.0)
    assert found.judgement.force is None and found.judgement.field is not None
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["final"]["judged"]["force"] is None


def test_the_record_is_plain_and_says_why_there_is_none():
    content = replay_record(check(observations(only_held(8.0))))
    assert content["outside"] and content["held_out"] and content["final"]["level"] == pytest.approx(1.0)
    assert replay_record(NoReplayCheck("no equilibrium")) == {"not_made": "no equilibrium"}
    assert replay_record(None) is None
