"""Derivatives of a replay by the parameters of a model."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from calibrate.diagnosis.replayed.parameter_spread import Directions
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from studies.replay.parameter_changes import of_parameters

BETA, END = 0.2, 0.2 + 1e-9
COMPRESSIBILITY = next(e for e in CATALOGUE if e.name == "compressibility")


@pytest.mark.parametrize("end", [np.inf, END])
def test_a_derivative_is_taken_from_the_side_where_there_is_a_stress(monkeypatch, end):
    """By the amplitude at the end of which a compressible sheet has none; by the base from above all the same."""

    def to(_, c, additions):
        (beta,) = additions[0].amplitudes
        return np.array([3.0 * (c[0] - 1.0) + (5.0 * (beta - BETA) if beta < end else np.nan)])

    monkeypatch.setattr("studies.replay.parameter_changes.Departure.to", to)
    directions = Directions.of(np.ones(1), (Addition(COMPRESSIBILITY, (BETA,)),), np.ones((1, 1)), 1.0)
    changes = SimpleNamespace(rows=SimpleNamespace(measured=np.zeros(1)))
    found = of_parameters(None, changes, directions, 1.0, np.ones(2, bool))
    np.testing.assert_allclose(found, [[3.0, 5.0]], rtol=1e-9)
