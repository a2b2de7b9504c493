"""Information and what it leaves uncertain: closed forms of linear-Gaussian estimation, and laws by finite differences."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrate.equations.deformation_modes import nominal_stress
from forward.materials import ArrudaBoyce, MooneyRivlin, NeoHooke
from forward.materials.tabulated import Tabulated
from studies.accuracy.metrics import MaterialDerivatives
from studies.design.information import Criteria, Information
from studies.design.law_family import LawFamily

STRETCHES = {"uniaxial": 2.0, "equibiaxial": 1.6, "pure_shear": 1.9}
FAMILY = LawFamily(ArrudaBoyce(), STRETCHES)


def random_information(seed, k=6, rows=4):
    rng = np.random.default_rng(seed)
    S, L = rng.standard_normal((rows, k)), np.linalg.cholesky(np.cov(rng.standard_normal((k, 4 * k))))
    return S, L, Information(S.T @ S, L)


def test_covariance_is_that_of_the_linear_model():
    S, L, found = random_information(1)
    covariance = np.linalg.inv(S.T @ S + np.linalg.inv(L @ L.T))
    assert found.root @ found.root.T == pytest.approx(covariance)
    sign, determinant = np.linalg.slogdet(np.eye(len(S)) + S @ L @ L.T @ S.T)
    assert sign * determinant / np.log(4) == pytest.approx(found.gain)
    c = np.random.default_rng(2).standard_normal((3, 6))
    assert found.deviation(c) == pytest.approx(np.sqrt(np.diag(c @ covariance @ c.T)))


def test_one_parameter():
    """Prior deviation s, one measurement of deviation d: half log2(1 + s^2 / d^2) bit; 1 / sqrt(1 + s^2 / d^2) of s is left."""
    found = Information(np.array([[1 / 0.1**2]]), np.array([[0.3]]))
    assert found.gain == pytest.approx(np.log2(10) / 2)
    assert found.worst == pytest.approx(1 / np.sqrt(10))


@given(st.integers(0, 1000))
def test_another_test_never_makes_less_certain(seed):
    _, L, one = random_information(seed)
    _, _, other = random_information(seed + 1)
    both = one + Information(other.fisher, L)
    c = np.random.default_rng(seed).standard_normal((5, 6))
    assert (both.deviation(c) <= one.deviation(c) * (1 + 1e-9)).all()
    assert both.gain >= one.gain - 1e-9
    assert both.worst <= one.worst + 1e-9
    assert one.worst == pytest.approx(1.0)  # four rows do not see all six directions


def test_nothing_known_is_the_prior():
    nothing = Information(np.zeros((FAMILY.size, FAMILY.size)), FAMILY.prior)
    assert nothing.gain == 0
    assert nothing.worst == 1
    for mode in STRETCHES:
        c = FAMILY.stress_sensitivity(mode)
        assert nothing.deviation(c) == pytest.approx(np.linalg.norm(c @ FAMILY.prior, axis=1))


def measured_in_tension(knots):
    """Criteria after the stress in uniaxial tension was measured to 1 %."""
    family = replace(FAMILY, knots=knots)
    rows = family.stress_sensitivity("uniaxial") / (0.01 * family.stress("uniaxial"))[:, None]
    return Criteria.of(Information(rows.T @ rows, family.prior), family)


def test_one_curve_does_not_tell_two_functions():
    """Uniaxial tension leaves equi-biaxial tension open, and closer knots converge to that: no artefact of the table."""
    overall = {knots: measured_in_tension(knots).overall for knots in (12, FAMILY.knots, 24, 48)}
    assert abs(overall[48] - overall[24]) < abs(overall[24] - overall[12]) / 4
    assert overall[FAMILY.knots] == pytest.approx(overall[48], rel=0.05)
    found = measured_in_tension(48)
    assert found.deviation["uniaxial"] < 0.01 < 0.5 < found.deviation["equibiaxial"]


@pytest.mark.parametrize("mode", STRETCHES)
def test_stress_is_linear_in_the_deviations(mode):
    """Tables beside neo-Hooke: stress of the table with a value changed, by the homogeneous formulas."""
    family = replace(FAMILY, base=NeoHooke(), knots=5)
    c = family.stress_sensitivity(mode)
    rng = np.random.default_rng(0)
    values = 0.1 * rng.standard_normal(family.size)
    first, second = family.places

    def derivatives(invariants):
        return np.stack(
            [
                np.interp(invariants[..., 0] - 3, first, values[:5]),
                np.interp(invariants[..., 1] - 3, second, values[5:]),
            ],
            -1,
        )

    assert c @ values == pytest.approx(nominal_stress(derivatives, mode, family.stretch(mode)))


def test_hats_are_the_slopes_of_the_varied_law():
    varied, step = FAMILY.varied, 1e-6
    assert isinstance(varied, Tabulated)
    at, n = np.array([4.3, 5.1]), FAMILY.size
    for k in (0, 3, n - 4):
        unit = list(np.eye(n)[k])
        slope = [
            (varied.energy(*(at + step * e), unit) - varied.energy(*(at - step * e), unit)) / (2 * step)
            for e in np.eye(2)
        ]
        assert FAMILY.hats(at)[:, k] == pytest.approx(slope, abs=1e-8)


def test_derivatives_of_the_expected_law():
    law = MooneyRivlin(0.12, 0.03)
    found = MaterialDerivatives(law)(np.array([[3.5, 3.4], [6.0, 9.0]]))
    assert found == pytest.approx(np.tile([0.12, 0.03], (2, 1)), rel=1e-8)
