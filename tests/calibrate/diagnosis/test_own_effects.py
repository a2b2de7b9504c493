"""Effects that each of several tests has for itself: their estimates have the stated errors, and what is alike is told from what is not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from discoveries import NOISE
from synthetic import ArrudaBoyce, plate_experiment, with_noise

from calibrate.diagnosis import base_fit, model_weights
from calibrate.diagnosis.discovery import discover
from calibrate.diagnosis.effect_fit import refit
from calibrate.diagnosis.evidence.own_effects import OwnEffect, own_effects, with_own_effects
from calibrate.diagnosis.evidence.priors import read_priors
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.problem import all_rows
from calibrate.effects import CATALOGUE
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


def test_estimates_have_their_stated_errors():
    """Residuals drawn from noise, discretisation and effects of each test: predictions are off by their deviations, and so are estimates freed of the
    prior, whatever the effects are."""
    plain, whole = prepared()
    parts = tuple(replace(part, own=part.own[:1]) for part in whole.parts)
    problem = model_weights.reweighted(replace(plain, parts=parts), plain.weights_c, ())
    noise = model_weights.reweighted(plain, plain.weights_c, ())
    inverses, fit = [_inverse(part.train) for part in noise.parts], refit(problem, problem.weights_c, ())
    rng, off, free = np.random.default_rng(3), [], []
    for _ in range(DRAWS):
        drawn = [rng.standard_normal(part.own[0].sources.shape[-1]) for part in problem.parts]
        raw = [
            (inverse @ rng.standard_normal(len(inverse))).reshape(part.train.rows.shape) - part.own[0].sources @ a
            for inverse, part, a in zip(inverses, problem.parts, drawn, strict=True)
        ]
        r = problem.whiten(raw)
        found = own_effects(problem, replace(fit, residual=r - fit.columns @ (fit.columns.T @ r)))
        for i, one in enumerate(found):
            true = np.array([a[i] for a in drawn]) * one.prior
            off.append((np.array(one.values) - true) / one.deviations)
            free.append((np.array(one.estimates) - true) / one.errors)
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(1.0, abs=5 / np.sqrt(2 * np.size(off)))
    assert np.sqrt(np.nanmean(np.square(free))) == pytest.approx(1.0, abs=5 / np.sqrt(2 * np.isfinite(free).sum()))


def _inverse(weights):
    """(r, r): from unit numbers to residuals of all equations, all of which are used."""
    size = weights.rows.size
    assert weights.size == size
    return np.linalg.inv(weights(np.eye(size).reshape(size, *weights.rows.shape)).T)


def made(estimates, errors, limit=3.0):
    tests = tuple(f"test {k}" for k in range(len(estimates)))
    return OwnEffect(
        StiffnessGradient(), StiffnessGradient().amplitudes[0], tests, 0.1, estimates, errors, estimates, errors, limit
    )


def test_what_is_alike_in_all_tests_is_of_no_test():
    same = made((0.20, 0.18, 0.22), (0.02, 0.02, 0.02))
    assert same.is_common
    assert same.seen_in == ()
    assert same.mean == pytest.approx((0.2, 0.02 / np.sqrt(3)))


def test_what_one_test_has_is_its_own():
    one = made((0.20, 0.01, -0.02), (0.02, 0.02, 0.02))
    assert not one.is_common
    assert one.seen_in == ("test 0",)


def test_a_test_that_tells_nothing_does_not_count():
    assert not made((0.2, float("nan")), (0.02, float("nan"))).is_common
    assert made((0.2, float("nan")), (0.02, float("nan"))).seen_in == ("test 0",)
    assert made((0.2, 0.19, float("nan")), (0.02, 0.02, float("nan"))).is_common


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
