"""Carroll's law: its default values are the weighted least-squares fit to the tests of Treloar (1944)."""

from __future__ import annotations

import numpy as np
from sheets import needs_data

from calibrate.equations.deformation_modes import MODES
from forward.materials import Carroll
from studies.importers import homogeneous_curves


def stress_of_each_term(mode, stretch):
    """Nominal stress (k, 3) of a, b, c = 1: 2 (x^2 - x3^2) / x (psi_1 + x2^2 psi_2), x2 the lateral stretch, x3 = 1 / (x x2)."""
    lateral = stretch ** MODES[mode].lateral_exponent
    squares = np.stack([stretch**2, lateral**2, (stretch * lateral) ** -2.0])
    I1, I2 = squares.sum(axis=0), (1 / squares).sum(axis=0)
    direction = 2 * (squares[0] - squares[2]) / stretch
    slopes = np.stack([np.ones_like(I1), 4 * I1**3, squares[1] / (2 * np.sqrt(I2))], axis=1)
    return direction[:, None] * slopes


@needs_data
def test_default_values_are_the_fit_to_treloar():
    """Squares weighted by 1 / stress; coefficients of determination as docs/generalise.md states them."""
    curves = {m: (x[P > 0], P[P > 0]) for m, (x, P) in homogeneous_curves.load("treloar-a").items()}
    terms = {mode: stress_of_each_term(mode, stretch) for mode, (stretch, _) in curves.items()}
    weight = np.concatenate([stress**-0.5 for _, stress in curves.values()])
    measured = np.concatenate([stress for _, stress in curves.values()])
    found = np.linalg.lstsq(np.concatenate([*terms.values()]) * weight[:, None], measured * weight)[0]
    np.testing.assert_allclose(Carroll().parameters, found, rtol=3e-4)
    for mode, stated in {"uniaxial": 0.998, "equibiaxial": 0.997, "pure_shear": 0.994}.items():
        stress = curves[mode][1]
        r2 = 1 - np.sum((terms[mode] @ found - stress) ** 2) / np.sum((stress - stress.mean()) ** 2)
        assert round(r2, 3) == stated
