"""What the forces of replays make of a model that the equations left wrong: the relaxation that a sheet was solved with, from its fitted increments alone."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibrate.data.experiment import Experiment, Noise
from calibrate.diagnosis import base_fit
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.replayed.updating import Updated, update
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from forward.loading import Loading
from forward.materials import NeoHooke
from forward.sheet.inelastic import solve_history
from forward.sheet.thin_sheet import Prony, Sheet
from meshes import quads, triangles
from meshes.known_specimens import SPECIMENS
from studies.replay.compared_test import ComparedTest
from studies.replay.fitted_replays import EACH, Replays, other_times
from studies.reports.discovery.replays.few_effects_table import update_record
from studies.synthetic import camera

STRIP = SPECIMENS["strip"]()
VISCO = next(effect for effect in CATALOGUE if effect.name == "viscoelasticity")
G, TAU, C10 = 0.8, 1.5, 0.2
FITTED = 6.0  # s


@cache
def ramp() -> Experiment:
    """Relaxation that is fast beside the ramp, as of a printed elastomer."""
    pull, times = Loading.clamped(STRIP.loaded, 15.0), np.arange(1.0, 11.0)
    true = solve_history(quads(STRIP), Sheet(NeoHooke(C10), 1.0, (), (Prony(G, TAU),)), pull, times / 10, times)
    exact = camera.observe(true, triangles(STRIP, n_nodes=250), name="strip")
    return replace(exact, noise=Noise(1e-3, 2.0, 1e-3))


@cache
def update_of(held_out_forces: float = 1.0) -> Updated:
    """From relaxation so slow and a base so soft that forces are 10 % off; forces after `FITTED` are a factor larger."""
    test = ramp()
    later = np.where(test.time > FITTED, held_out_forces, 1.0)[:, None]
    test = replace(test, loaded=tuple(replace(b, force=later * b.force) for b in test.loaded))
    problem, base = base_fit.prepare([test], [HoldOut.parse(f"after:{FITTED:g}", 0).training], base="neo-Hooke")
    additions = (Addition(VISCO, (0.3,), (20.0,)),)
    replays = Replays([ComparedTest(part, EACH, False) for part in problem.trained])
    priors = {VISCO.name: (np.zeros(1), np.ones(1))}
    found = update(replays, 0.8 * base.c, additions, priors, other_times(additions, problem))
    assert found is not None
    return found


def test_relaxation_that_is_faster_than_the_equations_have_it_is_found():
    found = update_of()
    (visco,) = found.additions
    assert found.converged
    assert found.after.force < 2e-3 < 0.05 < found.before.force
    assert visco.amplitudes[0] * visco.shape[0] == pytest.approx(G * TAU, rel=0.05)
    assert visco.shape[0] == pytest.approx(TAU, rel=0.1)


def test_a_lag_that_puts_a_picture_before_the_start_has_no_rows():
    problem, base = base_fit.prepare([ramp()], [HoldOut.parse("every:3", 0).training], base="neo-Hooke")
    replays = Replays([ComparedTest(part, EACH, False) for part in problem.trained])
    lag = next(effect for effect in CATALOGUE if effect.name == "lag between force and image")
    assert replays(base.c, (Addition(lag, (-1.5,), (-1.0,)),)) is None
    assert "is no test that could be" in replays.failure
    assert replays(base.c, (Addition(lag, (-0.1,), (-1.0,)),)) is not None


def test_nothing_that_is_held_out_is_used():
    own, other = update_of(), update_of(1.3)
    np.testing.assert_allclose(own.c, other.c, rtol=1e-9)
    assert own.additions[0].amplitudes == pytest.approx(other.additions[0].amplitudes, rel=1e-9)


def test_the_record_has_the_deviation_of_a_time() -> None:
    """Of discovery.json."""
    record = update_record(update_of())
    (visco,) = record["effects"]
    assert visco["shape"] == [pytest.approx(TAU, rel=0.1)]
    assert abs(visco["shape"][0] - TAU) < 1.96 * visco["shape_standard_deviations"][0]
    assert record["converged"] and record["replay"] is None  # not replayed at its level here
