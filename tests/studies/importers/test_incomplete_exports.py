"""Exports that a user really has: pictures that are not there, empty files, a specimen that leaves the view, pixels taken for mm."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from sheets import frame_text, motion, pixels, write
from vendor_exports import vic2d

from calibrate import errors
from studies.importers import printed_sheets, vendor_folder
from studies.importers.exports.field_guesses import pull_axis
from studies.importers.frame_tables import Frames
from studies.importers.recording.notes import strain_notes


def test_numbers_of_frames_that_are_not_there_count_as_time(tmp_path: Path) -> None:
    """Final0001, 0100 and 0189 are 99 and 188 intervals apart, not one and two."""
    for number, stretch in ((1, 1.0), (100, 1.2), (189, 1.4)):
        write(tmp_path / f"Final{number:04d}.csv", frame_text(motion(stretch)))
    frames = printed_sheets.read_frames(tmp_path)
    np.testing.assert_array_equal(frames.intervals, [0.0, 99.0, 188.0])
    np.testing.assert_array_equal(printed_sheets.Frames(pixels(), frames.displacements).intervals, [0.0, 1.0, 2.0])


def test_an_empty_frame_is_refused(tmp_path: Path) -> None:
    """Left out, it would give all frames after it the times and forces of others."""
    vic2d(tmp_path)
    first = min(tmp_path.glob("*.csv"))
    assert len(vendor_folder.exported(tmp_path, None).frames) > 2
    first.write_text("")
    with pytest.raises(errors.FileFormatError, match=f"{first.name}.*empty"):
        vendor_folder.exported(tmp_path, None)


def test_the_pull_is_seen_in_the_last_frame_with_points() -> None:
    x = np.stack(np.meshgrid(np.linspace(0, 10, 6), np.linspace(0, 5, 4)), axis=-1).reshape(-1, 2)
    u = np.stack([0 * x, x * [0.2, -0.1], np.full_like(x, np.nan)])
    assert pull_axis(Frames(x, u, None, []))[0] == 0
    u[:] = np.nan
    axis, why = pull_axis(Frames(x, u, None, []))
    assert axis is None
    assert "no frame" in why


@pytest.mark.parametrize(("factor", "said"), [(1.0, False), (100.0, True)])
def test_a_specimen_of_metres_is_asked_about(factor: float, said: bool) -> None:
    points = factor * np.array([[0.0, 0.0], [40.0, 0.0], [40.0, 20.0], [0.0, 20.0]])
    sheet = SimpleNamespace(
        points=points, thickness=2.0, stress_unit="MPa", strain_signal=SimpleNamespace(ratio=50.0, strain=0.4),
        loaded=[SimpleNamespace(force=np.array([[0.0, 10.0]]), nodes=np.array([0, 1]))],
    )  # fmt: skip
    assert any("pixels" in note for note in strain_notes(sheet)) is said  # type: ignore[arg-type]
