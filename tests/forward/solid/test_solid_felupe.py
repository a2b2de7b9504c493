"""An independent code on the same hexes of the cross: hand-derived stress and tangent, no condensation."""

import numpy as np
import pytest
import solid_felupe

from forward import ArrudaBoyce, Loading
from forward.solid.solid_model import solve
from meshes import Cross, extrude, quads

MATERIAL = ArrudaBoyce()
KAPPA = 1e4 * MATERIAL.shear_modulus


def both(size_factor, displacement, n_increments, mapped, theirs_in=None):
    """Our solution and felupe's, which takes `theirs_in` increments."""
    mesh = extrude(quads(Cross(), True, size_factor), 10.0, 1)
    loading = Loading.clamped(Cross.loaded, displacement, dimension=3)
    ours = solve(mesh, MATERIAL, loading, n_increments, KAPPA)
    return ours, solid_felupe.solve(mesh, MATERIAL, displacement, theirs_in or n_increments, KAPPA, mapped)


def test_same_element_same_result():
    """With the pressure linear in x, y, z there as well, the two agree but for rounding."""
    ours, theirs = both(4.0, 10.0, 2, mapped=False)
    assert ours.reactions["right"][-1, 0] == pytest.approx(theirs.right, rel=1e-10)
    assert ours.reactions["top"][-1, 1] == pytest.approx(theirs.top, rel=1e-10)
    np.testing.assert_allclose(ours.displacements[-1], theirs.displacements, atol=1e-9)
    np.testing.assert_allclose(ours.pressure[-1], theirs.pressure, atol=1e-8)


@pytest.mark.slow
def test_full_pull():
    """With felupe's usual pressure, linear in the hex's own coordinates, the forces at 60 mm are 0.2 % apart at most."""
    ours, theirs = both(4.0, 60.0, 10, mapped=True, theirs_in=20)
    assert ours.reactions["right"][-1, 0] == pytest.approx(theirs.right, rel=2e-3)
    assert ours.reactions["top"][-1, 1] == pytest.approx(theirs.top, rel=2e-3)
    np.testing.assert_allclose(ours.displacements[-1], theirs.displacements, atol=0.1)


@pytest.mark.slow
def test_the_two_pressures_approach_each_other():
    """The finer the mesh, the less it matters in which coordinates the pressure of a hex is linear."""
    forces, displacements = [], []
    for size_factor in (4.0, 1.0):
        ours, theirs = both(size_factor, 20.0, 4, mapped=True)
        forces.append(abs(theirs.right / ours.reactions["right"][-1, 0] - 1))
        displacements.append(np.sqrt(((theirs.displacements - ours.displacements[-1]) ** 2).mean()))
    assert max(forces) < 1e-4
    assert forces[0] / forces[1] > 4
    assert displacements[0] / displacements[1] > 2
