"""Effects that each of several tests has for itself: their estimates have the stated errors, and what is alike is told from what is not."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from discoveries import NOISE
from scipy import stats
from synthetic import ArrudaBoyce, plate_experiment, with_noise

from calibrate.diagnosis import base_fit, model_weights
from calibrate.diagnosis.discovery import discover
from calibrate.diagnosis.effect_fit import refit
from calibrate.diagnosis.evidence.explanations import CERTAIN, Finding
from calibrate.diagnosis.evidence.own_effects import OwnEffect, OwnSignatures, with_own_effects
from calibrate.diagnosis.evidence.power import powers
from calibrate.diagnosis.evidence.priors import read_priors
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.problem import all_rows
from calibrate.diagnosis.score_tests import Score, Status, untestable
from calibrate.effects import CATALOGUE
from calibrate.effects.finite_thickness import Thickness
from calibrate.effects.stiffness_gradient import StiffnessGradient
from studies.sheets.homogeneous import homogeneous_experiments
from studies.sheets.homogeneous.homogeneous_experiments import curve

DRAWS = 60


@cache
def prepared():
    """Two plates of one material: the problem without and with effects of each."""
    plates = [with_noise(plate_experiment(ArrudaBoyce(), n_increments=3), NOISE, seed) for seed in (1, 2)]
    plates = [replace(plate, name=f"plate {k}") for k, plate in enumerate(plates)]
    plain, base = base_fit.prepare(plates, [all_rows, all_rows])
    return plain, with_own_effects(plain, base, CATALOGUE, read_priors())[0]


def test_only_what_is_neither_of_material_nor_rig_is_of_one_test():
    names = {one.effect.name for one in prepared()[1].parts[0].own}
    assert names == {"stiffness gradient", "stiffness field", "inclusion", "initial warp", "unmeasured strip"}


@cache
def gradients_alone():
    """The same two plates with gradients of stiffness as the only effects of each: weights without them, signatures beside a fit, and an inverse root of the noise of both."""
    plain, whole = prepared()
    parts = tuple(replace(part, own=part.own[:1]) for part in whole.parts)
    problem = model_weights.reweighted(replace(plain, parts=parts), plain.weights_c, ())
    noise = model_weights.without_own_effects(problem)
    found = OwnSignatures.of(problem, noise, refit(problem, problem.weights_c, ()), read_priors())
    return noise, found, [_inverse(part.train) for part in noise.parts]


def told(rng, amplitudes):
    """Own effects of residuals drawn from noise and discretisation, of gradients (p,) in prior standard deviations in each test."""
    noise, found, inverses = gradients_alone()
    raw = [
        (inverse @ rng.standard_normal(len(inverse))).reshape(part.train.rows.shape) - one.sources @ a
        for inverse, part, (_, one, _), a in zip(inverses, noise.parts, found.cells, amplitudes, strict=True)
    ]
    return found.told(noise.whiten(raw))[0]


def test_amplitudes_have_their_stated_errors():
    """As they are drawn from the prior, of each test or alike in both."""
    rng, off = np.random.default_rng(3), []
    for k in range(DRAWS):
        drawn = rng.standard_normal((2, 2))
        drawn[1] = drawn[k % 2]
        one = told(rng, drawn)
        off.append((np.array(one.values) - drawn * one.prior) / one.deviations)
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(1.0, abs=5 / np.sqrt(2 * np.size(off)))


def test_what_is_told_is_seldom_something_else():
    """Of gradients of the size of the noise a third has none, a third each its own, a third the same: confident answers are wrong as seldom as they say."""
    rng, wrong = np.random.default_rng(4), 0
    for k in range(3 * DRAWS):
        drawn = 0.02 * rng.standard_normal((2, 2))
        one = told(rng, (0 * drawn, drawn, drawn[:1].repeat(2, axis=0))[k % 3])
        wrong += any(p > CERTAIN and k % 3 != here for here, p in ((1, one.own), (2, one.common)))
    assert wrong <= stats.binom.isf(1e-3, 3 * DRAWS, 1 - CERTAIN)


def _inverse(weights):
    """(r, r): from unit numbers to residuals of all equations, all of which are used."""
    size = weights.rows.size
    assert weights.size == size
    return np.linalg.inv(weights(np.eye(size).reshape(size, *weights.rows.shape)).T)


def made(own, common, values=((0.20, 0.0), (0.01, 0.0))):
    return OwnEffect(
        StiffnessGradient(), ("test 0", "test 1"), own, common, (0.1, 0.1), values, ((0.02, 0.02),) * 2, 3.0
    )


def test_what_is_alike_in_all_tests_is_of_no_test():
    same = made(0.02, 0.97)
    assert same.is_common
    assert same.seen_in == ()


def test_what_one_test_has_is_its_own():
    one = made(0.97, 0.02)
    assert not one.is_common
    assert one.seen_in == ("test 0",)


def test_what_may_be_either_is_told_of_the_tests_where_it_is_seen():
    one = made(0.5, 0.49)
    assert one.is_there
    assert not one.is_common
    assert one.seen_in == ("test 0",)


@pytest.mark.parametrize(
    ("amplitudes", "common", "seen_in"),
    [
        ((2.0, 0.0), False, ("plate 0",)),
        ((2.0, 2.0), True, ()),
        ((2.0, 0.0, 0.0), False, ("plate 0",)),
        ((2.0, 2.0, 0.0), True, ()),
    ],
)
def test_a_test_that_tells_nothing_does_not_count(amplitudes, common, seen_in):
    """Where the amplitude is none, the test has no signature of it: one test that tells is not alike with itself, two are."""
    _, found, _ = gradients_alone()
    rows = 40
    cells, r = [], np.zeros(rows * len(amplitudes))
    for k, a in enumerate(amplitudes):
        S = np.zeros((len(r), 2))
        S[rows * k : rows * (k + 1)] = 20 * np.random.default_rng(k).standard_normal((rows, 2)) * (a != 0)
        cells.append((f"plate {k}", found.cells[0][1], S))
        r -= S @ [a, 0.0]
    (one,) = OwnSignatures(tuple(cells), np.zeros((len(r), 0)), 1.0).told(r)
    assert one.is_common == common
    assert one.seen_in == seen_in


@pytest.mark.parametrize("gradients", [[(1.5, 0.0)] * 2, [(1.5, 0.0), (0.0, -1.0)], [(0.0, 0.0)] * 2])
def test_gradients_are_told_as_they_are(gradients):
    """Of both tests, of each, of none."""
    one = told(np.random.default_rng(5), np.array(gradients))
    alike, none = gradients[0] == gradients[1], not np.any(gradients)
    assert one.is_common == (alike and not none)
    assert one.is_there != none
    assert one.seen_in == (() if alike else ("plate 0", "plate 1"))


def test_what_a_specimen_may_have_is_tested_of_several_only_where_they_may_have_it_alike():
    """As of few effects by replays."""
    plain, _ = prepared()
    refused = untestable(plain, StiffnessGradient())
    assert refused is not None and refused.status is Status.NOT_TESTABLE
    assert untestable(plain, StiffnessGradient(), alike=True) is None


def test_what_each_test_may_have_is_not_called_invisible():
    """The score test does not test it: it has a table of its own."""
    _, problem = prepared()
    scores = [Score(effect, Status.NOT_TESTABLE) for effect in (StiffnessGradient(), Thickness())]
    last = SimpleNamespace(
        fit=SimpleNamespace(additions=(), deviations=()), candidates=[SimpleNamespace(score=score) for score in scores]
    )
    found = {one.effect.name: one.finding for one in powers(problem, last, 0.05, read_priors())}
    assert found == {"stiffness gradient": Finding.OWN, "3D effect of thickness": Finding.INVISIBLE}


def test_what_no_equation_inside_sees_hides_no_material():
    """Mooney and Rivlin's stress in two homogeneous tests. What varies over a specimen is one factor on its force there: as an effect of each test it would hide the
    second invariant, which makes one mode stiffer than the other."""
    stretch = np.linspace(1.1, 2.5, 15)
    modes = {"uniaxial": (stretch - stretch**-2, 1 / stretch), "equibiaxial": (stretch - stretch**-5, stretch**2)}
    noise = homogeneous_experiments.noise(0.002, 1e-4)
    both = [curve(mode, mode, stretch, 2 * x * (0.2 + 0.02 * y), noise) for mode, (x, y) in modes.items()]
    plain, base = base_fit.prepare(both, [all_rows, all_rows])
    assert [part.own for part in with_own_effects(plain, base, CATALOGUE, read_priors())[0].parts] == [(), ()]
    few = tuple(e for e in CATALOGUE if e.name in ("second invariant", "stiffness field", "lens distortion"))
    found = discover(both, HoldOut("every", 3), effects=few)
    assert "second invariant" in (*found.named, *found.closest)
