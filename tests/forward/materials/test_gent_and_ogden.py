"""Gent and Ogden: energies against principal stretches, and sheets against the textbook stresses of homogeneous states."""

import numpy as np
import pytest

from forward import Loading
from forward.errors import MaterialError
from forward.materials import Gent, NeoHooke, Ogden, material_from_dict
from forward.sheet.plane_stress import solve
from meshes import SquareSheet, Strip, quads

TERMS = ((0.63, 1.3), (0.0012, 5.0), (-0.01, -2.0))  # mu, MPa, and alpha of Ogden 1972
STEEP = Ogden(0.2, 8.3, 0.1, -4.7, 0.3, 0.4)


def principal(material):
    """mu and alpha of the terms."""
    return np.reshape(material.parameters, (3, 2))


def energy(material, stretches):
    """Ogden's own formula, MPa; stretches (2,) in the plane."""
    whole = [*stretches, 1 / np.prod(stretches)]
    return sum(mu / alpha * (sum(x**alpha for x in whole) - 3) for mu, alpha in principal(material))


def invariants(a, b):
    return a**2 + b**2 + (a * b) ** -2.0, a**-2.0 + b**-2.0 + (a * b) ** 2


def states():
    """Around rest, in uniaxial, equi-biaxial and plane states, where eigenvalues meet, and at random."""
    rng = np.random.default_rng(0)
    small = [1e-4, 5e-3, 0.02, 0.0255, 0.03, 0.2, 1.0, 4.0, -0.03, -0.4]
    named = [(1 + e, (1 + e) ** power) for e in small for power in (-0.5, 0.0, 1.0)]
    return [*named, *np.exp(rng.normal(0, 0.4, (50, 2))), *np.exp(rng.normal(0, 0.03, (50, 2)))]


@pytest.mark.parametrize("material", [Ogden(), STEEP], ids=["treloar", "steep"])
def test_ogden_energy_and_its_slope_along_the_first_stretch(material):
    step = 1e-5
    for a, b in states():
        expected = energy(material, (a, b))
        assert material.energy(*invariants(a, b)) == pytest.approx(expected, rel=1e-9, abs=1e-14)
        slope = [material.energy(*invariants(a + e, b)) for e in (step, -step)]
        own = [energy(material, (a + e, b)) for e in (step, -step)]
        scale = material.shear_modulus * abs(a - 1 / a) + abs(own[0] - own[1]) / step
        assert abs((slope[0] - slope[1]) - (own[0] - own[1])) / step < 1e-6 * scale + 1e-9


def test_ogden_with_even_exponents_is_mooney_rivlin_to_rounding():
    material = Ogden(0.3, 2.0, -0.08, -2.0, 0.0, 2.0)
    for a, b in states():
        I1, I2 = invariants(a, b)
        assert material.energy(I1, I2) == pytest.approx(0.15 * (I1 - 3) + 0.04 * (I2 - 3), rel=1e-10, abs=1e-14)
    assert material.shear_modulus == pytest.approx(0.38)


def test_gent_tends_to_neo_hooke_and_has_the_slope_of_the_paper():
    """dpsi/dI1 = mu / 2 Jm / (Jm - I1 + 3)."""
    I1, step = np.array([3.0, 5.0, 12.0]), 1e-5
    stiff = Gent(0.3, 20.0)
    slope = (stiff.energy(I1 + step, 3.0) - stiff.energy(I1 - step, 3.0)) / (2 * step)
    np.testing.assert_allclose(slope, 0.15 * 20 / (23 - I1), rtol=1e-8)
    np.testing.assert_allclose(Gent(0.3, 1e7).energy(I1, 3.0), NeoHooke(0.3).energy(I1, 3.0), rtol=1e-5)


@pytest.mark.parametrize(
    "make", [lambda: Gent(0.3, 0.0), lambda: Gent(-0.3), lambda: Ogden(alpha2=0.0), lambda: Ogden(mu1=-0.63)]
)
def test_impossible_values(make):
    with pytest.raises(MaterialError):
        make()


@pytest.mark.parametrize("material", [Gent(), Ogden()])
def test_dictionary(material):
    assert material_from_dict(material.to_dict()) == material


def nominal(material, a, b):
    """Nominal stress along a, MPa, from the textbook: lambda dpsi/dlambda - p, p from the free face."""
    if isinstance(material, Gent):
        x = invariants(a, b)[0] - 3
        return material.mu * material.Jm / (material.Jm - x) * (a - 1 / (a**3 * b**2))
    return sum(mu * (a**alpha - (a * b) ** -alpha) / a for mu, alpha in principal(material))


@pytest.mark.slow  # compiling Ogden's law takes 20 s
@pytest.mark.parametrize("material", [Gent(), Ogden()], ids=["gent", "ogden"])
def test_sheets_in_homogeneous_states(material):
    """Uniaxial tension to 2.5, pure shear to 2.2, equi-biaxial tension to 1.8, in three increments from rest."""
    strip = solve(quads(Strip(30.0, 10.0, far_size=8.0), quarter=True), material, Loading({"right": (45.0, None)}), 3)
    square = quads(SquareSheet(10.0, 10.0, far_size=5.0), quarter=True)
    shear = solve(square, material, Loading({"right": (0.0, None), "top": (None, 12.0)}), 3)
    biaxial = solve(square, material, Loading({"right": (8.0, None), "top": (None, 8.0)}), 3)
    for t in range(3):
        a = 1 + (t + 1) / 3 * np.array([1.5, 1.2, 0.8])
        assert strip.reactions["right"][t, 0] == pytest.approx(10 * nominal(material, a[0], a[0] ** -0.5), rel=1e-9)
        assert shear.reactions["top"][t, 1] == pytest.approx(10 * nominal(material, a[1], 1.0), rel=1e-9)
        assert shear.reactions["right"][t, 0] == pytest.approx(10 * nominal(material, 1.0, a[1]), rel=1e-9)
        assert biaxial.reactions["right"][t, 0] == pytest.approx(10 * nominal(material, a[2], a[2]), rel=1e-9)
