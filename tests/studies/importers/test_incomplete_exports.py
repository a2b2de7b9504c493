"""Exports that a user really has: pictures that are not there, empty files, a specimen that leaves the view, pixels taken for mm."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sheets import frame_text, motion, pixels, write
from vendor_exports import vic2d

from calibrate import errors
from calibrate.data.experiment import Experiment
from studies.commands.import_data import Request, read
from studies.importers import printed_sheets, vendor_folder
from studies.importers.exports.field_guesses import has_rest, pull_axis
from studies.importers.exports.guesses import Undecided
from studies.importers.frame_tables import Frames
from studies.importers.recording.notes import pull_notes, repeated_frame_notes, strain_notes
from studies.importers.vendor_folder import exported


class _Sheet(SimpleNamespace):
    """What notes read of an Experiment."""

    largest_forces = Experiment.largest_forces
    is_biaxial = Experiment.is_biaxial


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


def test_a_frame_of_a_header_alone_is_refused(tmp_path: Path) -> None:
    vic2d(tmp_path)
    first = min(tmp_path.glob("*.csv"))
    first.write_text(first.read_text().splitlines()[0] + "\n")
    (tmp_path / "notes.csv").write_text("operator,remark\n")
    with pytest.raises(errors.FileFormatError, match=f"{first.name}.*no row of numbers"):
        vendor_folder.exported(tmp_path, None)


def test_the_pull_of_a_cyclic_test_is_seen_where_it_is_deformed_most() -> None:
    """It ends where it began but for a residue, wider across than along."""
    x = np.stack(np.meshgrid(np.linspace(0, 40, 6), np.linspace(0, 80, 9)), axis=-1).reshape(-1, 2)
    u = np.stack([x * strain for strain in ([0.0, 0.0], [-0.15, 0.4], [0.002, -0.001])])
    axis, why = pull_axis(Frames(x, u, None, []))
    assert axis == 1 and "40 % along y in frame 2" in why


@pytest.mark.parametrize("strain", [1e-3, 0.3])  # of the last picture
def test_noise_or_a_wrong_row_in_the_first_file_is_no_load(strain: float) -> None:
    """White noise of 2 um, and one of 96 points that jumped by 0.5 mm; a load of 2 % of the last picture's is one, if it is above its noise."""
    x = np.stack(np.meshgrid(np.linspace(0, 40, 8), np.linspace(0, 80, 12)), axis=-1).reshape(-1, 2)
    noise = np.random.default_rng(1).normal(0.0, 2e-3, (3, *x.shape))
    pulled = x * [-0.4 * strain, strain]
    jumped = np.zeros_like(x)
    jumped[17] = 0.5
    jumped[40] = np.nan

    def rests(first: np.ndarray) -> bool:
        return has_rest(Frames(x, np.stack([first, pulled / 2 + noise[1], pulled + noise[2]]), None, []))

    assert rests(noise[0]) and rests(jumped) and rests(0 * x)
    assert not rests(0.02 * pulled)
    assert rests(0.02 * pulled + noise[0]) == (strain < 0.3)
    assert not rests(0 * x + 0.1)  # moved as a whole


def test_a_noisy_first_file_gives_no_frame_of_its_own(tmp_path: Path) -> None:
    """Every time would be late by one picture; 0.02 px of noise beside 100 px."""
    vic2d(tmp_path)
    first = min(tmp_path.glob("*.csv"))
    head, *rows = first.read_text().splitlines()
    rng = np.random.default_rng(0)
    for i, row in enumerate(rows):
        fields = row.split(",")
        fields[2:4] = [f"{float(f) + rng.normal(0.0, 0.02):.5f}" for f in fields[2:4]]
        rows[i] = ",".join(fields)
    first.write_text("\n".join([head, *rows]) + "\n")
    with pytest.raises(Undecided) as asked:
        read(str(tmp_path), Request())
    assert asked.value.guesses.get("points.reference") is None
    assert any("which is no load" in fact for fact in asked.value.guesses.facts)


def pulled_strip(elongations: list[float], forces: list[float], across: float = -0.4) -> Any:
    """20 x 40 mm, pulled along y."""
    points = np.stack(np.meshgrid(np.linspace(0, 20, 3), np.linspace(0, 40, 5)), axis=-1).reshape(-1, 2)
    u = np.array(elongations)[:, None, None] * points * [across, 1.0]
    force = np.array(forces)[:, None] * [0.0, 1.0]
    return _Sheet(points=points, displacements=u, loaded=[SimpleNamespace(force=f) for f in (force, -force)])


def test_what_a_wrong_sign_and_a_wrong_order_look_like_is_said() -> None:
    there_and_back, forces = [0.1, 0.2, 0.3, 0.2, 0.1], [1.0, 2.0, 2.9, 1.7, 0.8]
    assert pull_notes(pulled_strip(there_and_back, forces)) == []
    (wide,) = pull_notes(pulled_strip(there_and_back, forces, 0.4))
    assert "30 % along y" in wide and "12 % across" in wide and "sign" in wide
    (swapped,) = pull_notes(pulled_strip([0.1, 0.3, 0.2, 0.4, 0.5], [1.0, 2.0, 3.0, 4.0, 5.0]))
    assert "increment 3 from" in swapped and "--order" in swapped
    held = [0.1, 0.3, 0.3, 0.301, 0.301]  # a relaxing force is no contradiction
    assert pull_notes(pulled_strip(held, [1.0, 3.0, 2.5, 2.3, 2.2])) == []
    assert pull_notes(pulled_strip([0.1, 0.2, 0.3, 0.4], [1.0, 2.0, np.nan, 4.0])) == []  # nor is one that is not known
    both = pulled_strip(there_and_back, forces, 0.9)
    both.loaded.append(SimpleNamespace(force=np.array(forces)[:, None] * [1.0, 0.0]))
    assert pull_notes(both) == []


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
    sheet = _Sheet(
        points=points, displacements=0.2 * points[None] * [-0.5, 1.0],
        thickness=2.0, stress_unit="MPa", strain_signal=SimpleNamespace(ratio=50.0, strain=0.4),
        loaded=[SimpleNamespace(force=np.array([[0.0, 10.0]]), nodes=np.array([0, 1]))],
    )  # fmt: skip
    assert any("pixels" in note for note in strain_notes(sheet)) is said  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("factor", "said"), [(1.0, None), (1e3, "more than any"), (1e-3, "less than any"), (0.0, None)]
)
def test_kilonewtons_and_millinewtons_for_newtons_are_asked_about(factor: float, said: str | None) -> None:
    """10 N over 40 x 1 mm and a strain of 0.4: 0.6 MPa."""
    points = np.array([[0.0, 0.0], [40.0, 0.0], [40.0, 20.0], [0.0, 20.0]])
    sheet = _Sheet(
        points=points, displacements=0.2 * points[None] * [-0.5, 1.0],
        thickness=1.0, stress_unit="MPa", strain_signal=SimpleNamespace(ratio=50.0, strain=0.4),
        loaded=[SimpleNamespace(force=factor * np.array([[0.0, 10.0]]), nodes=np.array([0, 1]))],
    )  # fmt: skip
    told = [note for note in strain_notes(sheet) if "force.unit" in note]  # type: ignore[arg-type]
    assert len(told) == (said is not None) and all(said is not None and said in note for note in told)


def test_a_frame_with_other_columns_is_named(tmp_path):
    """Left out it would shift the forces of all after it. A machine record with a name of its own is none."""
    for k in range(4):
        rows = "".join(f"{x},{y},{0.1 * k * x},0.0,0.01\n" for x in range(8) for y in range(6))
        (tmp_path / f"img_{k}.csv").write_text("X,Y,U,V,sigma\n" + rows)
    (tmp_path / "machine.csv").write_text("Time [s],Force [N]\n" + "".join(f"{k},{k}.5\n" for k in range(4)))
    first = tmp_path / "img_2.csv"
    first.write_text(first.read_text().replace("X,Y,U,V", "a,b,c,d"))
    with pytest.raises(errors.FileFormatError, match="img_2.csv: other columns than those of the frames"):
        exported(tmp_path, None)
    assert len(exported(tmp_path, "img_[013].csv").frames) == 3


def test_a_frame_that_was_exported_twice_is_told():
    u = np.arange(24.0).reshape(4, 3, 2)
    u[0] = 0.0
    assert repeated_frame_notes(u, np.array([1, 2, 3])) == []
    u[3] = u[2]
    (note,) = repeated_frame_notes(u, np.array([1, 2, 3]))
    assert "frames 2 and 3" in note
    assert repeated_frame_notes(u, np.array([1, 3])) == []
