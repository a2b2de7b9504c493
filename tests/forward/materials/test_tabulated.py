"""A law given by values at knots: against closed forms that are piecewise linear, and its own numerical slopes."""

import json

import numpy as np
import pytest
from forward_helpers import MATERIALS
from hypothesis import given
from hypothesis import strategies as st

from forward import material_from_dict
from forward.errors import MaterialError
from forward.materials.tabulated import Tabulated

LAW = Tabulated((0.0, 1.0, 3.0), (0.15, 0.12, 0.2), (0.0, 2.0), (0.02, 0.01))


@given(st.floats(3.0, 12.0), st.floats(3.0, 12.0))
def test_slopes_are_straight_lines_between_the_knots(I1, I2):
    step = 1e-6
    first = (LAW.energy(I1 + step, I2) - LAW.energy(I1 - step, I2)) / (2 * step)
    second = (LAW.energy(I1, I2 + step) - LAW.energy(I1, I2 - step)) / (2 * step)
    assert first == pytest.approx(np.interp(I1 - 3, LAW.knots_1, LAW.slopes_1), abs=1e-6)
    assert second == pytest.approx(np.interp(I2 - 3, LAW.knots_2, LAW.slopes_2), abs=1e-6)


def test_constant_slopes_are_the_solid_by_mooney_and_rivlin():
    known = MATERIALS["mooney_rivlin"]
    law = Tabulated((0.0, 2.0, 5.0), (known.c10,) * 3, (0.0, 1.0), (known.c01,) * 2)
    for I1, I2 in ((3.0, 3.0), (4.0, 3.5), (9.0, 14.0)):
        assert law.energy(I1, I2) == pytest.approx(known.energy(I1, I2), abs=1e-15)
    assert law.shear_modulus == pytest.approx(known.shear_modulus)


def test_dictionary():
    assert material_from_dict(json.loads(json.dumps(LAW.to_dict()))) == LAW


@pytest.mark.parametrize(
    ("changed", "says"),
    [({"slopes_1": (0.1, 0.2)}, "as many"), ({"knots_1": (0.0, 3.0, 1.0)}, "rise"), ({"knots_1": (1.0, 2.0, 3.0)}, "at rest"),
     ({"slopes_1": (-0.1, 0.2, 0.2)}, "positive")],
)  # fmt: skip
def test_what_is_refused(changed, says):
    with pytest.raises(MaterialError, match=says):
        Tabulated(
            **{**{name: getattr(LAW, name) for name in ("knots_1", "slopes_1", "knots_2", "slopes_2")}, **changed}
        )
