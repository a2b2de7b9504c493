"""The machine record of an Experiment: kept by its file, refused where it cannot be, and how far the motion is between pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_sheet import stretched

from calibrate import errors
from calibrate.data.experiment import Experiment, LoadRecord


def record(time=(0.0, 0.5, 1.5, 2.5, 3.5), crosshead=None) -> LoadRecord:
    """Of two boundaries; the pull of the second grows with time, its other component was not measured."""
    time = np.asarray(time, float)
    pull = np.stack([np.full(time.shape, np.nan), time], axis=1)
    return LoadRecord(time, np.stack([-pull, pull]), crosshead)


@pytest.mark.parametrize("crosshead", [None, np.arange(5.0)])
def test_file_and_subset_keep_the_whole_record(tmp_path, crosshead):
    sheet = stretched(record=record(crosshead=crosshead))
    sheet.save(tmp_path / "sheet.npz")
    read = Experiment.load(tmp_path / "sheet.npz")
    for again in (read, read.select([1])):
        np.testing.assert_array_equal(again.record.time, sheet.record.time)
        np.testing.assert_array_equal(again.record.force, sheet.record.force)
        assert (again.record.crosshead is None) == (crosshead is None)
    assert read.fingerprint == stretched().fingerprint  # a model file of before knows the test
    assert read.without_time().record is None


def test_a_file_without_a_record_is_read(tmp_path):
    stretched().save(tmp_path / "sheet.npz")
    with np.load(tmp_path / "sheet.npz") as file:
        assert not any(name.startswith("record") for name in file.files)
    assert Experiment.load(tmp_path / "sheet.npz").record is None


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"time": [0.0, 1.0, 1.0, 2.0, 4.0]}, errors.TimeError, "reading 3"),
        ({"time": [np.nan, 1.0, 2.0, 3.0, 4.0]}, errors.TimeError, "reading"),
        ({"time": [0.0, 1.0, 2.0]}, errors.MeshMismatchError, "does not match time"),
        ({"crosshead": np.zeros(3)}, errors.MeshMismatchError, "crosshead"),
        ({"crosshead": np.full(5, np.nan)}, errors.ExperimentError, "crosshead"),
        ({"force": np.zeros((2, 5))}, errors.MeshMismatchError, "expected"),
        ({"time": [1.0], "force": np.zeros((2, 1, 2))}, errors.MissingForceError, "two readings"),
    ],
)
def test_records_that_cannot_be_are_named(changes, error, words):
    with pytest.raises(error, match=words):
        replace(record(), **changes)


def test_a_reading_without_a_force_is_named():
    force = record().force.copy()
    force[1, 3, 1] = np.nan
    with pytest.raises(errors.MissingForceError, match="along y at loaded boundary 2 in reading 4"):
        replace(record(), force=force)


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"record": record(time=[0.0, 0.5, 1.0, 2.0, 2.9])}, errors.TimeError, "0 to 2.9 s, the pictures from 1 to 3 s"),
        ({"record": record(time=[1.1, 1.5, 2.0, 2.5, 3.5])}, errors.TimeError, "1.1 to 3.5 s"),
        ({"record": LoadRecord(np.arange(5.0), np.zeros((1, 5, 2)))}, errors.MeshMismatchError, "1 boundaries, 2 are loaded"),
        ({"record": record(), "time": None}, errors.TimeError, "the pictures have no time"),
    ],
)  # fmt: skip
def test_records_of_another_test_are_named(changes, error, words):
    with pytest.raises(error, match=words):
        stretched(**changes)


def test_forces_are_read_between_readings():
    found = record().at(np.array([0.25, 3.0]))
    np.testing.assert_allclose(found[1, :, 1], [0.25, 3.0])
    np.testing.assert_allclose(found[0, :, 1], [-0.25, -3.0])
    assert np.isnan(found[:, :, 0]).all()


PICTURES = np.array([1.0, 2.0, 4.0])


def test_without_a_crosshead_motion_goes_as_time_does():
    times = np.array([0.5, 1.0, 1.25, 3.0, 4.0])
    readings = np.linspace(0, 5, 51)
    np.testing.assert_allclose(record(readings).progress(PICTURES, times), [0.5, 1.0, 1.25, 2.5, 3.0])
    # a picture at rest at 0 s is the first one
    np.testing.assert_allclose(record(readings).progress(np.array([0.0, 2.0]), np.array([0.0, 1.0])), [1.0, 1.5])


@pytest.mark.parametrize("noise", [0.0, 2e-3])
def test_a_ramp_that_ends_between_two_pictures_ends_where_the_crosshead_stops(noise):
    """A ramp to 2.5 s, then a hold: at 2.5 s the motion has arrived at the third picture, taken at 4 s."""
    time = np.linspace(0, 5, 501)
    crosshead = np.minimum(time, 2.5) + noise * np.random.default_rng(0).standard_normal(501)
    found = record(time, crosshead).progress(PICTURES, np.array([0.5, 1.5, 2.25, 2.5, 3.0, 3.9]))
    np.testing.assert_allclose(found, [0.5, 1.5, 2.5, 3.0, 3.0, 3.0], atol=20 * noise + 1e-12)
    assert (found <= 3.0).all()


def test_where_the_crosshead_turns_or_stands_motion_goes_as_time_does():
    time = np.linspace(0, 5, 501)
    turning = np.where(time < 3.5, time, 7 - time)  # back at 3 mm when the third picture is taken
    standing = np.minimum(time, 2.0)
    for crosshead in (turning, standing):
        assert record(time, crosshead).progress(PICTURES, np.array([3.0]))[0] == pytest.approx(2.5)
