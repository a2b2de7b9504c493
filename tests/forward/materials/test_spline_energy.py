"""A law given by a cubic spline: its slope is that of the basis of a diagnosis, within and beyond its range."""

from __future__ import annotations

import json

import numpy as np
import pytest

from calibrate.equations.basis import SingleBasis
from calibrate.equations.splines import pieces_of
from forward import material_from_dict
from forward.errors import MaterialError
from forward.materials.spline_energy import SplineEnergy

BASIS = SingleBasis(0, 5.0, 9)
C = 0.1 + 0.05 * np.sin(np.arange(9.0))
LAW = SplineEnergy(BASIS.top, tuple(map(tuple, pieces_of(C).tolist())))


def test_its_slope_is_the_spline():
    I1, step = 3 + np.linspace(0.01, 9.0, 400), 1e-5
    slope = (LAW.energy(I1 + step, 3.0) - LAW.energy(I1 - step, 3.0)) / (2 * step)
    expected = BASIS.spline.matrix(np.sqrt(np.minimum((I1 - 3) / BASIS.top, 1.0))) @ C
    np.testing.assert_allclose(slope, expected, atol=2e-6)


def test_rest_and_dictionary():
    assert LAW.energy(3.0, 3.0) == pytest.approx(0.0, abs=1e-14)
    assert LAW.shear_modulus == pytest.approx(2 * C[0])
    assert material_from_dict(json.loads(json.dumps(LAW.to_dict()))) == LAW


@pytest.mark.parametrize(
    ("top", "pieces", "says"), [(0.0, LAW.pieces, "top"), (1.0, (), "pieces"), (1.0, ((-0.1, 0, 0, 0),), "positive")]
)
def test_what_is_refused(top, pieces, says):
    with pytest.raises(MaterialError, match=says):
        SplineEnergy(top, pieces)


def test_all_that_tells_two_splines_apart_is_a_parameter():
    """So that compiled code serves both."""
    other = SplineEnergy(3.0, tuple(map(tuple, pieces_of(C[::-1]).tolist())))
    I1 = 3 + np.linspace(0.01, 9.0, 50)
    np.testing.assert_array_equal(LAW.energy(I1, 3.0, other.parameters), other.energy(I1, 3.0))
