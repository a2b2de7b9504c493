"""Ogden-Roxburgh damage and dispersed fibres in sheets, against closed forms of homogeneous states."""

import numpy as np
import pytest
from forward_helpers import nominal_stresses
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from scipy.special import erf

from forward import Loading, NeoHooke
from forward.errors import MaterialError
from forward.sheet.additions import Fibres
from forward.sheet.damage_and_dispersion import DispersedFibres, OgdenRoxburgh
from forward.sheet.inelastic import solve_history
from forward.sheet.thin_sheet import Sheet
from meshes import SquareSheet, quads

NEO, H, SIDE = NeoHooke(0.4), 1.5, 10.0  # MPa; thickness and half side, mm
PULLS = {
    "uniaxial": Loading({"right": (SIDE, None)}),
    "pure shear": Loading({"right": (SIDE, None), "top": (None, 0.0)}),
    "equi-biaxial": Loading({"right": (SIDE, None), "top": (None, SIDE)}),
}
LATERAL = {"uniaxial": -0.5, "pure shear": 0.0, "equi-biaxial": 1.0}
FACTORS = [0.3, 0.8, 0.4, 0.1, 0.6, 1.0, 0.5]
LARGEST = [0.3, 0.8, 0.8, 0.8, 0.8, 1.0, 1.0]


@pytest.fixture(scope="module")
def square():
    return quads(SquareSheet(SIDE, SIDE, far_size=10.0), quarter=True)


def stress_of(solution, side="right"):
    """Mean nominal stress, MPa, along the normal of a side of the quarter."""
    return solution.reactions[side][:, ("right", "top").index(side)] / (SIDE * H)


def energy(mode, a):
    """Neo-Hooke, MPa."""
    b = a ** LATERAL[mode]
    return 0.2 * (a**2 + b**2 + (a * b) ** -2 - 3)


@pytest.mark.parametrize("mode", PULLS)
def test_ogden_roxburgh(square, mode):
    """eta of the paper on the neo-Hookean stress, over loading, unloading and loading beyond."""
    r, m, beta = 1.6, 0.05, 0.2
    found = solve_history(square, Sheet(NEO, H, (OgdenRoxburgh(r, m, beta),)), PULLS[mode], FACTORS, np.arange(1, 8))
    a = 1 + np.array(FACTORS)
    W, largest = energy(mode, a), energy(mode, 1 + np.array(LARGEST))
    eta = 1 - erf((largest - W) / (m + beta * largest)) / r
    primary = nominal_stresses(NEO, a, a ** LATERAL[mode])[0]
    np.testing.assert_allclose(stress_of(found), eta * primary, rtol=1e-8)


def test_ogden_roxburgh_loses_the_work_that_the_paper_says(square):
    """Work up less work down = (1/r) int erf((W_max - W) / m) dW from the last energy to the largest."""
    r, m = 1.6, 0.15
    up, down = np.linspace(0.05, 1.0, 20), np.linspace(0.95, 0.05, 19)
    damage = (OgdenRoxburgh(r, m),)
    found = solve_history(square, Sheet(NEO, H, damage), PULLS["uniaxial"], [*up, *down], np.arange(1, 40))
    stress = stress_of(found)
    lost = CubicSpline(up, stress[:20]).integrate(0.05, 1.0)
    lost -= CubicSpline([*down[::-1], 1.0], stress[19:][::-1]).integrate(0.05, 1.0)
    last, largest = energy("uniaxial", 1.05), energy("uniaxial", 2.0)
    assert lost == pytest.approx(quad(lambda W: erf((largest - W) / m) / r, last, largest)[0], rel=1e-4)


def fibre_energy(fibres, a, b):
    """Of Gasser, Ogden and Holzapfel, MPa, at in-plane stretches along x and y."""
    I1, total = a**2 + b**2 + (a * b) ** -2.0, 0.0
    for angle in fibres.angles:
        I4 = (a * np.cos(angle)) ** 2 + (b * np.sin(angle)) ** 2
        E = fibres.kappa * (I1 - 3) + (1 - 3 * fibres.kappa) * (I4 - 1)
        total += fibres.k1 / (2 * fibres.k2) * np.expm1(fibres.k2 * max(E, 0.0) ** 2)
    return total


def stresses(fibres, a, b, h=1e-6):
    """Nominal stresses along x and y, MPa: the slopes of the energy in the plane, fibres by central differences."""
    along = (fibre_energy(fibres, a + h, b) - fibre_energy(fibres, a - h, b)) / (2 * h)
    across = (fibre_energy(fibres, a, b + h) - fibre_energy(fibres, a, b - h)) / (2 * h)
    base = nominal_stresses(NEO, a, b)
    return np.array([base[0] + along, base[1] + across])


@pytest.mark.parametrize("kappa", [0.0, 0.15, 1 / 3])
def test_dispersed_fibres(square, kappa):
    """Families on both sides of x: no shear; in uniaxial tension the transverse stretch from P22 = 0 by a root."""
    fibres = DispersedFibres(0.1, 0.6, kappa, (0.5, -0.5))
    sheet = Sheet(NEO, H, (fibres,))
    for mode in ("pure shear", "equi-biaxial"):
        found = solve_history(square, sheet, PULLS[mode], [0.3, 0.6], [1, 2])
        expected = stresses(fibres, 1.6, 1.6 ** LATERAL[mode])
        np.testing.assert_allclose([stress_of(found, s)[-1] for s in ("right", "top")], expected, rtol=1e-7)
    found = solve_history(square, sheet, PULLS["uniaxial"], [0.3, 0.6], [1, 2])
    b = brentq(lambda b: stresses(fibres, 1.6, b)[1], 0.4, 1.2, xtol=1e-12)
    assert stress_of(found)[-1] == pytest.approx(stresses(fibres, 1.6, b)[0], rel=1e-7)
    np.testing.assert_allclose(found.displacements[-1], found.points * [0.6, b - 1], atol=1e-6)


def test_dispersed_fibres_in_both_notations(square):
    """In tension along the fibres."""
    k1, k2, kappa = 0.1, 0.6, 0.15
    level = (1 - 3 * kappa) ** 2
    found = [
        solve_history(square, Sheet(NEO, H, (fibres,)), PULLS["pure shear"], [0.6], [1])
        for fibres in (DispersedFibres(k1, k2, kappa, (0.4,)), Fibres(k1 * level, (0.4,), k2 * level, kappa))
    ]
    assert stress_of(found[0])[0] == pytest.approx(stress_of(found[1])[0], rel=1e-9)


def test_fibres_carry_no_compression(square):
    """Across the pull every family is shortened: the sheet is neo-Hookean."""
    found = solve_history(
        square, Sheet(NEO, H, (DispersedFibres(0.5, 1.0, 0.0, (np.pi / 2, -np.pi / 2)),)), PULLS["uniaxial"], [0.5], [1]
    )
    assert stress_of(found)[0] == pytest.approx(nominal_stresses(NEO, 1.5, 1.5**-0.5)[0], rel=1e-9)


@pytest.mark.parametrize(
    "make",
    [
        lambda: OgdenRoxburgh(0.9, 0.1),
        lambda: OgdenRoxburgh(2.0, 0.0, 0.0),
        lambda: OgdenRoxburgh(2.0, -0.1, 0.2),
        lambda: DispersedFibres(0.1, 0.5, 0.4, (0.0,)),
        lambda: DispersedFibres(0.1, 0.0, 0.1, (0.0,)),
    ],
)
def test_impossible_values(make):
    with pytest.raises(MaterialError):
        make()
