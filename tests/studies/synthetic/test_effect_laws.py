"""Effects of the catalogue as laws of a sheet."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from calibrate.effects import CATALOGUE, Effect, Parameter
from forward.materials import NeoHooke
from studies.synthetic.effect_laws import ADDITIONS, Extent, sheet

NEVER_NONE = 1e-6  # shapes halve at most from step to step


def ends(shape: Parameter) -> tuple[float, float]:
    """Of what a fit may end at."""
    lower = NEVER_NONE if shape.lower == 0 else shape.lower
    return max(lower, -np.pi), min(shape.upper, 100.0)


@pytest.mark.parametrize("effect", [e for e in CATALOGUE if e.name in ADDITIONS and e.shapes], ids=lambda e: e.name)
def test_whatever_shape_a_fit_may_end_at_can_be_solved(effect: Effect) -> None:
    amplitudes = {p.name: p.typical for p in effect.amplitudes}
    for values in product(*map(ends, effect.shapes)):
        shape = {p.name: value for p, value in zip(effect.shapes, values, strict=True)}
        described = sheet(NeoHooke(0.4), 1.0, [(effect.name, amplitudes, shape)], Extent(60.0))
        assert len(described.additions) == 1
