"""Whether the crosshead and the grips in the pictures start to move at the same time, and what a diagnosis makes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sheets import SCALE, motion, needs_data, pixels, record_text, sheet, write, write_frames

from calibrate.data.experiment import Experiment
from calibrate.effects import CATALOGUE
from calibrate.effects.effect import Effect
from calibrate.effects.support.effect_data import Data
from studies.importers import printed_sheets
from studies.importers.recording.grip_motion import clocks
from studies.importers.recording.series import to_experiment
from studies.importers.recording.stated_noise import StatedNoise
from studies.importers.recording.synchronise import ForceRecord
from studies.reports.experiments.import_report import report_lines

RATE, BEFORE = 5.0, 3  # Hz; pictures before the start


def crosshead(time):
    """mm: 0.4 mm/s after a start of a tenth of a second."""
    time = np.maximum(np.asarray(time), 0.0)
    return 0.4 * np.where(time < 0.1, 5 * time**2, time - 0.05)


def series(late=0.0, noise=1e-3, record_from=0.0):
    """A sheet whose pictures are `late`, s, and whose load train gives way by a fifth at first, less later."""
    taken = (np.arange(60) - BEFORE) / RATE + late
    pulled = crosshead(taken) - crosshead(taken[0])
    stretch = 1 + pulled * (0.8 + 0.02 * pulled) / 13
    u = np.stack([motion(one) for one in stretch])
    u += np.random.default_rng(0).normal(0.0, noise / SCALE, u.shape)
    u[0] = 0.0
    time = np.arange(record_from, 14.0, 0.02)
    record = ForceRecord(time, 2 * crosshead(time), crosshead=crosshead(time))
    options = printed_sheets.SheetOptions(scale=SCALE, frame_rate=RATE, offset=-BEFORE / RATE)
    return printed_sheets.sheet_series(printed_sheets.Frames(pixels(), u), record, options)


def lag() -> Effect:
    return next(effect for effect in CATALOGUE if effect.name == "lag between force and image")


@pytest.mark.parametrize("late", [-0.7, -0.05, 0.0, 0.08, 0.5])
def test_late_pictures_are_found(late):
    found = clocks(series(late))
    assert found is not None
    assert found.offset == pytest.approx(late, abs=0.02)
    assert found.std < 0.02
    assert found.agree == (late == 0.0)


def test_nothing_is_said_of_clocks_that_cannot_be_compared():
    one = series()
    assert clocks(replace(one, record=replace(one.record, crosshead=None))) is None
    assert clocks(replace(one, has_clock=False)) is None
    assert clocks(series(record_from=1.0)) is None  # the crosshead moves already
    assert clocks(series(late=1.0)) is None  # the pictures begin in full motion
    still = ForceRecord(one.record.time, one.record.force, crosshead=np.zeros_like(one.record.time))
    assert clocks(replace(one, record=still)) is None


@pytest.mark.parametrize("late", [-2.5, 0.0, 3.7])
def test_few_pictures_with_a_way_back_are_compared_as_a_whole(late):
    """Fifteen of them, two before a quarter of the elongation; the turn tells the time."""
    one = series()
    time = np.linspace(0.0, 28.0, 15)
    path = np.interp(time, [0.0, 2.0, 18.0, 28.0], [0.0, 0.0, 6.4, 2.4])
    stretch = 1 + path * (0.8 + 0.02 * path) / 13
    u = (stretch - 1)[:, None, None] * (one.points - one.points.min(axis=0)) * [0.0, 1.0]
    machine = np.arange(-5.0, 36.0, 0.1)
    pulled = np.interp(machine - late, [0.0, 2.0, 18.0, 28.0], [0.0, 0.0, 6.4, 2.4])
    record = ForceRecord(machine, 2 * pulled, crosshead=pulled)
    found = clocks(replace(one, time=time, displacements=u, record=record))
    assert found is not None and found.offset == pytest.approx(late, abs=0.1)
    assert found.agree == (late == 0.0)


def test_noise_does_not_count_as_agreement():
    found = clocks(series(noise=1.0))
    assert found is None or not found.agree


def test_a_lag_below_the_interval_of_the_pictures_stays_a_candidate():
    """It is measured to a hundredth of that; only what the noise of the forces holds already is no lag."""
    late, small = (replace(series(one), synchronisation_std=0.2 / np.sqrt(12)) for one in (0.08, 0.04))
    stated = to_experiment(replace(late, synchronisation_std=0.0))
    assert not stated.is_synchronised and not lag().excluded(Data.of(stated))
    assert any("add +0.08 s to the offset (--offset, frames.offset_s)" in note for note in stated.provenance["notes"])
    assert not to_experiment(late).is_synchronised  # of rate_hz = 5: 0.058 s
    counted = to_experiment(small)
    assert counted.is_synchronised
    assert any(
        "beyond what the noise of the forces holds; +0.04" in line for line in report_lines(counted, Path("e.npz"))
    )
    forces = StatedNoise(force_std=0.01)
    assert not to_experiment(small, noise=forces).is_synchronised


def test_no_lag_is_a_candidate_where_the_clocks_agree():
    for late, agree in ((0.0, True), (0.5, False)):
        e = to_experiment(series(late))
        assert e.is_synchronised is agree
        assert lag().excluded(Data.of(e)) is agree
        assert any("s to the offset" in note for note in e.provenance["notes"]) is not agree
        assert any("there is no lag" in line for line in report_lines(e, Path("e.npz"))) is agree


def test_the_offset_that_a_note_asks_for_mends_the_clocks():
    one = series(0.5)
    found = clocks(one)
    assert found is not None
    again = clocks(replace(one, time=one.time + found.offset))
    assert again is not None and again.agree


def test_it_survives_the_file(tmp_path):
    to_experiment(series()).save(tmp_path / "e.npz")
    assert Experiment.load(tmp_path / "e.npz").is_synchronised


def test_a_record_without_a_crosshead_is_read_as_before(tmp_path):
    folder = write_frames(tmp_path)
    assert printed_sheets.read_record(folder / "force_disp.txt").crosshead is not None
    lines = [",".join(line.split(",")[::2]) for line in record_text().splitlines()]
    write(folder / "force_disp.txt", "\n".join(lines) + "\n")
    assert printed_sheets.read_record(folder / "force_disp.txt").crosshead is None
    assert not sheet(folder).is_synchronised


@needs_data
@pytest.mark.parametrize("name", ["Soft_Homo", "Stiff2_Homo", "Stiff2_Hetero"])
def test_published_sheets_have_one_clock(name):
    from studies.commands.import_data import Request, read

    found = clocks(read(name, Request())[1].series)
    assert found is not None and found.std < abs(found.offset) < 0.2 / np.sqrt(12)
