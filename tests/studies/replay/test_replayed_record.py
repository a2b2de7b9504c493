"""A replay predicts the force between the pictures: of a relaxation faster than these, and of a ramp that ends between two of them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibrate.data.experiment import Experiment
from forward.loading import Loading
from forward.materials import NeoHooke
from forward.sheet.inelastic import solve_history
from forward.sheet.thin_sheet import Prony, Sheet
from meshes import quads, triangles
from meshes.known_specimens import SPECIMENS
from studies.output import Manifest
from studies.replay.model_law import Law
from studies.replay.replayed_experiment import replay
from studies.replay.report import write_report
from studies.synthetic import camera

STRIP = SPECIMENS["strip"]()
TRUE = Sheet(NeoHooke(0.2), 1.0, (), (Prony(0.8, 0.4),))
PICTURES = [2, 4, 6]  # s
READINGS = [
    (t, min(t / 2.5, 1.0)) for t in np.arange(0.25, 6, 0.25) if t not in PICTURES
]  # a ramp of 2.5 s, then a hold


@cache
def ramp_that_ends_between_two_pictures() -> Experiment:
    pull = Loading.clamped(STRIP.loaded, 15.0)
    true = solve_history(quads(STRIP), TRUE, pull, [0.8, 1.0, 1.0], [float(t) for t in PICTURES], readings=READINGS)
    return camera.observe(true, triangles(STRIP, n_nodes=250), name="strip")


def record_error(sheet: Sheet, experiment: Experiment) -> float:
    found = replay(experiment, Law(sheet, ""), check_mesh=False)
    assert found.record is not None
    return found.record.error


def test_a_relaxation_faster_than_the_pictures_is_seen_between_them():
    """At the pictures a law without a history but a little stiffer is as good; at the readings it is not."""
    test = ramp_that_ends_between_two_pictures()
    found = replay(test, Law(TRUE, ""), check_mesh=False)
    record = found.record
    assert record.error < 3e-3
    assert record.time[0] > 0 and record.time[-1] == 6.0
    assert np.isin(test.time, record.solved).all()
    assert len(record.solved) >= 24
    name, force = next(iter(found.forces.items()))
    np.testing.assert_allclose(record.forces[name][np.isin(record.solved, test.time)], force, rtol=1e-12)
    slow = replace(TRUE, prony=(Prony(0.8, 0.04),))
    assert record_error(slow, test) > 10 * record.error


def test_without_the_crosshead_the_corner_of_the_loading_is_missed():
    test = ramp_that_ends_between_two_pictures()
    blind = replace(test, record=replace(test.record, crosshead=None))
    assert record_error(TRUE, blind) > 5 * record_error(TRUE, test)


def test_an_elastic_law_is_replayed_between_the_pictures_too(tmp_path):
    test = ramp_that_ends_between_two_pictures()
    found = replay(test, Law(Sheet(NeoHooke(0.2)), "neo-Hooke"), check_mesh=False)
    hold = found.record.solved > 2.5
    for force in found.record.forces.values():  # nothing relaxes while it is held
        np.testing.assert_allclose(
            force[hold], np.broadcast_to(force[-1], force[hold].shape), atol=1e-3 * np.abs(force).max()
        )
    report = write_report(tmp_path, found, Manifest(settings={}))
    assert "machine record" in report.read_text()
    table = (tmp_path / "record.csv").read_text().splitlines()
    assert len([line for line in table if line[:1].isdigit()]) == len(found.record.time)
    largest, at = found.record.largest
    assert largest == pytest.approx(max(
        np.abs(found.record.replayed[name] - force).max() for name, force in found.record.measured.items()))  # fmt: skip
    assert at in found.record.time


def test_without_a_record_forces_are_those_at_the_pictures():
    bare = replace(ramp_that_ends_between_two_pictures(), record=None)
    found = replay(bare, Law(Sheet(NeoHooke(0.2)), ""), check_mesh=False)
    assert found.record is None
    assert not found.solution.readings
