"""How far the data of a test reach, against the quantile of single triangles."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic import MooneyRivlin, plate_experiment

from calibrate.equations.equilibrium import equilibrium
from calibrate.fitting.calibrated_range import calibrated_range, largest_fibre_stretch


def test_fibres_are_stretched_most_along_the_pull():
    system = equilibrium(plate_experiment(MooneyRivlin(), n_increments=3))
    every, F = np.ones(3, bool), system.deformation_gradients
    along = {angle: largest_fibre_stretch(system, every, angle, 1.0) for angle in (0.0, np.pi / 4, np.pi / 2)}
    for angle, found in along.items():
        M = np.array([np.cos(angle), np.sin(angle)])
        assert found == pytest.approx(max(float((f @ M) @ (f @ M)) for f in F.reshape(-1, 2, 2)), rel=1e-12)
    assert max(along.values()) > 1.1 * min(along.values())
    last = np.array([False, False, True])
    assert largest_fibre_stretch(system, last, 0.0, 0.5) <= along[0.0]
    assert calibrated_range(system, quantile=1.0)["I1"][1] > 3.0
