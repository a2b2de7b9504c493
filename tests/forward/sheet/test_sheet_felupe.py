"""An independent code on the same coarse cross."""

import forward_felupe
import numpy as np
import pytest

from forward import ArrudaBoyce, Loading
from forward.sheet.plane_stress import solve
from meshes import Cross, quads


def test_same_reactions_and_displacements_as_felupe():
    mesh, material = quads(Cross(), quarter=True, size_factor=3.0), ArrudaBoyce()
    ours = solve(mesh, material, Loading.clamped(Cross.loaded, 60.0), 10)
    displacements, right, top, _ = forward_felupe.solve(mesh, material, 60.0, 20)
    assert ours.reactions["right"][-1, 0] == pytest.approx(right, rel=1e-3)
    assert ours.reactions["top"][-1, 1] == pytest.approx(top, rel=1e-3)
    # both use 3 x 3 Gauss points, so they agree far better than asked for
    assert ours.reactions["right"][-1, 0] == pytest.approx(right, rel=1e-7)
    np.testing.assert_allclose(ours.displacements[-1], displacements, atol=1e-5)
