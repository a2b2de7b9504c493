"""Pictures that are missing from a series."""

import numpy as np
import pytest

from studies.importers.recording.missing_frames import missing_frames
from studies.importers.recording.synchronise import ForceRecord, forces_at


def steady(n=60):
    """Displacements (n, 100, 2) of points that move on at an even pace, with a little jitter."""
    points = np.random.default_rng(0).uniform(0, 40, (100, 2))
    field = np.stack([-0.3 * points[:, 0], points[:, 1]], axis=1) / 40
    jitter = 0.02 * np.random.default_rng(1).normal(size=n)
    return field, (np.arange(n) + jitter)[:, None, None] * 0.08 * field


def test_missing_frames_are_counted():
    _, u = steady()
    kept = np.delete(np.arange(60), [20, 21, 40])
    assert missing_frames(0.2 * np.arange(57), u[kept]) == {20: 2, 38: 1}
    assert missing_frames(0.2 * np.arange(60), u) == {}


def test_a_slip_is_no_missing_frame():
    """A step twice as long, but of another field, is the specimen's own."""
    field, u = steady()
    slip = u.copy()
    slip[30:] += 0.08 * np.stack([field[:, 1], field[:, 0]], axis=1) * 1.5
    assert missing_frames(0.2 * np.arange(60), slip) == {}
    assert missing_frames(np.cumsum(np.linspace(0.1, 0.3, 60)), u) == {}


def test_a_force_that_was_read_with_a_picture_stays_with_it():
    """A record with a row for each picture moves with them; that of a machine, which has its own clock, does not."""
    before, after = 0.2 * np.arange(6), np.array([0.0, 0.2, 0.6, 0.8, 1.0, 1.2])
    force = np.array([0.0, 1.0, np.nan, 3.0, 4.0, 5.0])
    own = ForceRecord(before, force, per_frame=True).moved(before, after)
    assert forces_at(own, after[[1, 3, 5]]) == pytest.approx([1.0, 3.0, 5.0]) and own.blank == (3,)
    machine = ForceRecord(before, force)
    assert machine.moved(before, after) is machine
