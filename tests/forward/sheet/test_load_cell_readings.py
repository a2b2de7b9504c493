"""Forces read on the way to the increments: those of a run that has increments there, also after a kill."""

from __future__ import annotations

import numpy as np
import pytest
from interrupted import interrupted

from forward import Loading, NeoHooke, SurfaceSolution
from forward.errors import LoadingError
from forward.sheet.inelastic import solve_history
from forward.sheet.thin_sheet import Prony, Sheet
from meshes import PlateWithHole, quads

LOADING = Loading.clamped(PlateWithHole.loaded, 20.0)
SHEET = Sheet(NeoHooke(0.4), 1.2, (), (Prony(0.5, 0.7),))
FACTORS, TIMES = [0.5, 1.0, 1.0], [1.0, 2.0, 4.0]
READINGS = ((0.4, 0.3), (1.5, 0.9), (2.2, 1.0), (3.0, 1.0))  # a corner at 0.4 s, and one at 1.5 s


@pytest.fixture(scope="module")
def mesh():
    return quads(PlateWithHole(), quarter=True, size_factor=4.0)


def run(mesh, checkpoint=None, readings=READINGS):
    return solve_history(mesh, SHEET, LOADING, FACTORS, TIMES, checkpoint=checkpoint, readings=readings)


def test_readings_are_the_forces_of_increments_at_their_moments(mesh, tmp_path):
    found = run(mesh)
    every = sorted([*zip(TIMES, FACTORS, strict=True), *READINGS])
    expected = solve_history(mesh, SHEET, LOADING, [factor for _, factor in every], [time for time, _ in every])
    np.testing.assert_array_equal(found.reading_times, [time for time, _ in READINGS])
    at = np.isin(expected.time, found.reading_times)
    for side, force in expected.reactions.items():
        size = np.abs(force).max()
        np.testing.assert_allclose(found.readings[side], force[at], atol=1e-8 * size)
        np.testing.assert_allclose(found.reactions[side], force[~at], atol=1e-8 * size)
    found.save(tmp_path / "s.npz")
    again = SurfaceSolution.load(tmp_path / "s.npz")
    np.testing.assert_array_equal(again.reading_times, found.reading_times)
    np.testing.assert_array_equal(again.readings["right"], found.readings["right"])


@pytest.mark.parametrize("reached", [1, 2])
def test_a_run_goes_on_with_its_readings(mesh, tmp_path, reached):
    path = tmp_path / "run.npz"
    with interrupted(reached):
        run(mesh, path)
    assert len(SurfaceSolution.load(path).reading_times) == [0, 1, 2][reached]
    found, expected = run(mesh, path), run(mesh)
    np.testing.assert_array_equal(found.readings["right"], expected.readings["right"])
    np.testing.assert_array_equal(found.displacements, expected.displacements)


@pytest.mark.parametrize(
    ("readings", "words"),
    [(((0.5, 0.1), (0.4, 0.2)), "must rise"), (((4.5, 1.0),), "4 s"), (((0.0, 0.0),), "above 0 s"), (((2.0, 1.0),), "leave it out")],
)  # fmt: skip
def test_readings_that_cannot_be_are_named(mesh, readings, words):
    with pytest.raises(LoadingError, match=words):
        run(mesh, readings=readings)
