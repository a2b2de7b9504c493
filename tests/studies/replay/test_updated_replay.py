"""What the forces of replays make of a model that the equations left wrong: the relaxation that a sheet was solved with, from its fitted increments alone."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from calibrate.data.experiment import Experiment, Noise
from calibrate.diagnosis import base_fit
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.joint import everything
from calibrate.diagnosis.joint.shares import Everything, Share
from calibrate.diagnosis.misfit import Misfit
from calibrate.diagnosis.replayed.checked_replay import NoReplayCheck
from calibrate.diagnosis.replayed.updating import Updated
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from forward.loading import Loading
from forward.materials import NeoHooke
from forward.sheet.inelastic import solve_history
from forward.sheet.thin_sheet import Prony, Sheet
from meshes import quads, triangles
from meshes.known_specimens import SPECIMENS
from studies.replay.updated_replay import updated
from studies.reports.discovery.everything_table import everything_record, updated_table
from studies.synthetic import camera

STRIP = SPECIMENS["strip"]()
VISCO, STRIP_BESIDE = (
    next(effect for effect in CATALOGUE if effect.name == name) for name in ("viscoelasticity", "unmeasured strip")
)
G, TAU, C10 = 0.8, 1.5, 0.2
FITTED = 6.0  # s


@cache
def ramp() -> Experiment:
    """Relaxation that is fast beside the ramp, as of a printed elastomer."""
    pull, times = Loading.clamped(STRIP.loaded, 15.0), np.arange(1.0, 11.0)
    true = solve_history(quads(STRIP), Sheet(NeoHooke(C10), 1.0, (), Prony(G, TAU)), pull, times / 10, times)
    exact = camera.observe(true, triangles(STRIP, n_nodes=250), name="strip")
    return replace(exact, noise=Noise(1e-3, 2.0, 1e-3))


@cache
def update_of(held_out_forces: float = 1.0, strip: bool = False) -> Updated:
    """From relaxation so slow and a base so soft that forces are 10 % off; forces after `FITTED` are a factor larger."""
    test = ramp()
    later = np.where(test.time > FITTED, held_out_forces, 1.0)[:, None]
    test = replace(test, loaded=tuple(replace(b, force=later * b.force) for b in test.loaded))
    problem, base = base_fit.prepare([test], [HoldOut.parse(f"after:{FITTED:g}", 0).training], base="neo-Hooke")
    addition = Addition(VISCO, (0.3,), (20.0,))
    share = SimpleNamespace(effect=VISCO, amplitudes=(0.3,), deviations=(0.05,), priors=(1.0,))
    more = (Addition(STRIP_BESIDE, (0.5,)),) if strip else ()
    fit = SimpleNamespace(c=0.8 * base.c, additions=(addition, *more))
    return updated(everything.simple_base(problem), SimpleNamespace(fit=fit, shares=(share,)))


def test_relaxation_that_is_faster_than_the_equations_have_it_is_found():
    found = update_of()
    (visco,) = found.additions
    assert found.converged
    assert found.after.force < 2e-3 < 0.05 < found.before.force
    assert visco.amplitudes[0] * visco.shape[0] == pytest.approx(G * TAU, rel=0.05)
    assert visco.shape[0] == pytest.approx(TAU, rel=0.1)


def test_nothing_that_is_held_out_is_used():
    own, other = update_of(), update_of(1.3)
    np.testing.assert_allclose(own.c, other.c, rtol=1e-9)
    assert own.additions[0].amplitudes == pytest.approx(other.additions[0].amplitudes, rel=1e-9)


def test_what_finite_elements_do_not_have_is_left_out_and_said():
    own, other = update_of(), update_of(strip=True)
    assert (own.left_out, other.left_out) == ((), ("unmeasured strip",))
    assert other.c == pytest.approx(own.c)
    assert other.additions[0].amplitudes == pytest.approx(own.additions[0].amplitudes)


def test_the_report_has_what_was_updated_beside_what_the_equations_said():
    """Values, units and the record of discovery.json."""
    share = Share(VISCO, (0.3,), (0.05,), (1.0,), (20.0,), 5.0, 0.2)
    misfits = (Misfit(0.1, 0.05, 9.0, 100), None)
    one = Everything(SimpleNamespace(converged=True), (share,), misfits, misfits, 1.0, 1.0, updated=update_of())
    columns, rows = updated_table(one, "MPa")
    assert columns[2:] == ["by the equations", "updated"]
    assert [row[:2] for row in rows] == [["viscoelasticity", "g"], ["viscoelasticity", "tau (s)"]]
    value, half = map(float, rows[1][3].split(" +- "))
    assert float(rows[1][2]) == 20.0 and value == pytest.approx(TAU, rel=0.1) and abs(value - TAU) < half
    record = everything_record(one)["updated"]
    assert record["effects"][0]["shape_standard_deviations"] == [pytest.approx(half / 1.96, rel=0.05)]
    assert record["converged"] and record["replay"] is None and not record["used"]  # not replayed at its level here
    assert updated_table(replace(one, updated=NoReplayCheck("no force is known")), "MPa") is None
