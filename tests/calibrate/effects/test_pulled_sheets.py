"""Effects on sheets whose stress is known in closed form: a bowed reference, relaxation on one ramp, another batch."""

import json
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import legendre
from pulled_sheets import BASIS, SIZE, material, read_as, section_forces, uniaxial

from calibrate.diagnosis import base_fit, effect_fit, score_tests
from calibrate.diagnosis.problem import all_rows
from calibrate.effects.chain import Addition, Chain
from calibrate.effects.compressibility import Compressibility
from calibrate.effects.viscosity import Viscosity
from calibrate.effects.warp import NEXT_ORDERS, ORDER, InitialWarp, integrals
from calibrate.equations.equilibrium import equilibrium
from calibrate.models.extended_model import ExtendedModel


def test_warp_strains_are_legendre_polynomials():
    x = np.linspace(-1, 1, 9)
    for k in range(ORDER + 3):
        expected = legendre.legval(x, legendre.legint(np.eye(ORDER + 3)[k], lbnd=-1))
        assert np.asarray(integrals(jnp.asarray(x)))[k] == pytest.approx(expected, abs=1e-12)


def test_next_orders_of_a_bend_are_half_of_those_two_before():
    """Root mean squares of the Legendre coefficients of cylinders bent by a Gaussian height, half as wide as the sheet and less, anywhere in its middle half, and of any whose slopes are cubics."""
    rng = np.random.default_rng(0)
    x, weights = legendre.leggauss(80)
    place, width = rng.uniform(-0.6, 0.6, (2000, 1)), rng.uniform(0.5, 1.0, (2000, 1))
    strain = ((x - place) / width) ** 2 * np.exp(1 - ((x - place) / width) ** 2)
    cubics = (rng.standard_normal((2000, 4)) @ legendre.legvander(x, 3).T) ** 2
    for bends, within in ((strain, 0.15), (cubics, 0.25)):
        of_each = [(k + 0.5) * bends * weights @ legendre.legval(x, np.eye(7)[k]) for k in range(7)]
        size = np.sqrt(np.mean(np.square(of_each), axis=1))
        assert [size[5] / size[3], size[6] / size[4]] == pytest.approx(2 * [NEXT_ORDERS], rel=within)


def test_a_doubted_warp_has_its_next_orders():
    """As a chain has it, against the places that the strain's integral makes; those of the chain itself have none."""
    amplitudes = np.zeros(2 * (ORDER + 1))
    amplitudes[3], amplitudes[ORDER + 1 + 4] = 0.002, -0.001
    X, data = uniaxial().points, Chain(equilibrium(uniaxial(), 12.0), BASIS).with_doubted_formulas().data
    low, high = X.min(axis=0), X.max(axis=0)
    x = 2 * (X - low) / (high - low) - 1
    series = np.array([[0, 0, 0, 0.002, 0, 0.001, 0], [0, 0, 0, 0, -0.001, 0, -0.0005]])
    regained = [legendre.legval(x[:, i], legendre.legint(series[i], lbnd=-1)) for i in range(2)]
    doubted = np.asarray(InitialWarp().places(data, X, amplitudes, ()))
    assert doubted - X == pytest.approx(0.5 * (high - low) * np.stack(regained, axis=1), abs=1e-12)
    series[:, ORDER + 1 :] = 0.0
    regained = [legendre.legval(x[:, i], legendre.legint(series[i], lbnd=-1)) for i in range(2)]
    stated = np.asarray(InitialWarp().places(replace(data, doubt=0.0), X, amplitudes, ()))
    assert stated - X == pytest.approx(0.5 * (high - low) * np.stack(regained, axis=1), abs=1e-12)


def test_stated_deviations_hold_the_error_of_the_formula():
    """2 % of what is apart from none, 5 % of the beginning of a series, in squares beside other errors; where an amplitude is none there is no formula to be wrong."""
    assert Addition(Viscosity(), (0.5,), (3.0,)).with_formula_error((0.01,)) == pytest.approx((np.hypot(0.01, 0.01),))
    (first, second, *_) = Addition(InitialWarp(), (0.0, 0.004, *8 * (0.0,)), ()).with_formula_error(10 * (1e-4,))
    assert (first, second) == pytest.approx((1e-4, np.hypot(1e-4, 0.05 * 0.004)))


def test_a_sheet_that_was_bowed_is_flattened():
    """A slope q = s y / L makes the strain q^2 / 2, which is 1 / 3 p_0 + 2 / 3 p_2 of its largest; forces are those of the
    flat sheet, whose length and height the seen ones are not."""
    s = 0.1
    y = uniaxial().points[:, 1] - SIZE / 2
    lost = s**2 / 6 * y**3 / (SIZE / 2) ** 2  # integral of q^2 / 2
    move = np.stack([np.zeros_like(y), lost], axis=1)
    seen = replace(uniaxial(), points=uniaxial().points - move, displacements=uniaxial().displacements + move)
    amplitudes = np.zeros(2 * (ORDER + 1))
    amplitudes[ORDER + 1], amplitudes[ORDER + 3] = s**2 / 6, s**2 / 3
    addition = Addition(InitialWarp(), tuple(amplitudes), ())
    flat, bowed, wrong = (
        Chain(equilibrium(e, 12.0), BASIS).residual(material().c, additions)
        for e, additions in ((uniaxial(), ()), (seen, (addition,)), (seen, ()))
    )
    size = np.abs(wrong - flat).max()
    assert np.abs(bowed - flat).max() < 0.03 * size


@pytest.mark.parametrize(("base", "within"), [("neo-Hooke", 0.1), ("positive", 0.3)])
def test_on_one_ramp_relaxation_is_told_from_a_base_by_its_prior(base, within):
    """An energy of I1 can soften with strain as a branch relaxes with time, but rubber seldom does: beside splines the strength is known less well."""
    learnt = material(Addition(Viscosity(), (0.5,), (3.0,)))
    e = read_as(uniaxial(), learnt)
    problem, fit = base_fit.prepare([e], [all_rows], 12.0, base=base)
    found = next(s for s in score_tests.score(problem, fit, [Viscosity()]) if s.effect.name == Viscosity.name)
    fit = effect_fit.refit(problem, fit.c, (Addition(Viscosity(), (0.0,), (3.0,)),))
    assert found.adjusted < 1e-6
    (g,), (error,) = fit.additions[0].amplitudes, fit.errors[0]
    assert g == pytest.approx(0.5, abs=2 * within)
    assert error < within


def test_scaling_a_material_scales_its_stress():
    """beta in 1/MPa falls as the stiffness rises, so that the volume ratio stays."""
    soft = material(Addition(Compressibility(), (0.2,)))
    assert section_forces(uniaxial(), soft.scaled(3.0)) == pytest.approx(3 * section_forces(uniaxial(), soft), rel=1e-9)
    assert ExtendedModel.from_dict(json.loads(json.dumps(soft.to_dict()))).additions == soft.additions
