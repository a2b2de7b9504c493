"""Several tests of one material by the forward model, whose specimens have something of their own or of the rig."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibrate.diagnosis.discovery import discover
from calibrate.diagnosis.selection import Verdict
from forward.materials import ArrudaBoyce
from studies.replay.replay_check import FiniteElementCheck
from studies.replay.twin_replay import twin_replay
from studies.trials.blind_data import draw, make
from studies.trials.blind_effects import Hidden

MATERIAL, C01 = ArrudaBoyce(0.4, 12.0), 0.06
FIRST = 7  # seed, of development; what fresh ones gave: docs/limits.md


@cache
def found(*gradients, c01=0.0):
    """The diagnosis of as many tests, with gradients (gx, gy) of the stiffness, and a second invariant."""
    tests = []
    for k, (gx, gy) in enumerate(gradients):
        hidden = [Hidden("stiffness gradient", {"gx": gx, "gy": gy}, {}, {})] if gx or gy else []
        hidden += [Hidden("second invariant", {"c01": c01}, {}, {})] if c01 else []
        trial = replace(draw(FIRST + k, None), material=MATERIAL, thickness=2.0, effects=tuple(hidden))
        tests.append(replace(make(trial)[0], name=f"test {k}"))
    return discover(tests, fitted=False, replay=twin_replay, check=FiniteElementCheck())


def gradient(discovery):
    """Of each test: own or common, amplitudes gx and gy and their deviations."""
    return next(one for one in discovery.own if one.effect.name == "stiffness gradient")


def off(one, gradients):
    """Largest deviation from the true gradients (n, 2), in standard deviations."""
    return float(np.max(np.abs(np.array(one.values) - np.array(gradients)) / np.array(one.deviations)))


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is():
    result = found((0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
    assert result.verdict is Verdict.NOTHING_SIGNIFICANT
    assert not any(one.is_there for one in result.own)


@pytest.mark.slow
def test_gradients_of_the_specimens_do_not_spoil_what_the_material_has():
    """In different directions, beside a second invariant, which is found as large as it is; replays of the joint model, which lack the gradients, do not speak against it."""
    gradients = (0.0, 0.15), (0.0, 0.0), (-0.1, 0.0)
    result = found(*gradients, c01=C01)
    assert result.verdict is Verdict.EXPLAINED
    assert result.named == ("second invariant",)
    ((value,), (deviation,)) = result.final.additions[0].amplitudes, result.final.errors[0]
    assert value == pytest.approx(C01, abs=3 * deviation)
    assert deviation < 0.02 * C01
    one = gradient(result)
    assert one.seen_in == ("test 0", "test 2")
    assert off(one, gradients) < 3


@pytest.mark.slow
def test_a_gradient_that_all_have_is_of_the_rig():
    gradients = [(0.0, 0.15)] * 3
    result = found(*gradients)
    assert result.verdict is Verdict.NOTHING_SIGNIFICANT  # of what the material has
    one = gradient(result)
    assert one.is_common
    assert off(one, gradients) < 3
