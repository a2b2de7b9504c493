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
from calibrate.effects.warp import ORDER, InitialWarp, integrals
from calibrate.equations.equilibrium import equilibrium
from calibrate.models.extended_model import ExtendedModel


def test_warp_strains_are_legendre_polynomials():
    x = np.linspace(-1, 1, 9)
    for k in range(ORDER + 1):
        expected = legendre.legval(x, legendre.legint(np.eye(ORDER + 1)[k], lbnd=-1))
        assert np.asarray(integrals(jnp.asarray(x)))[k] == pytest.approx(expected, abs=1e-12)


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
