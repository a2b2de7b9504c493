"""The ParaView file holds what the Experiment holds."""

import numpy as np
import pyvista

from calibrate.data.experiment import Experiment, LoadedBoundary
from studies.output.viewer import write_viewer_file


def test_viewer_file_round_trip(tmp_path):
    points = np.array([[0.0, 0], [10, 0], [10, 10], [0, 10]])
    u = np.stack([0.1 * points * [1, 0], 0.2 * points * [1, 0]])
    force = np.array([[1.0, 0], [2.0, 0]])
    loaded = (LoadedBoundary("right", np.array([1, 2]), force),)
    experiment = Experiment("square", points, np.array([[0, 1, 2], [0, 2, 3]]), u, loaded, np.array([0, 3]), 1.0)
    grid = pyvista.read(write_viewer_file(experiment, tmp_path / "square.vtu"))
    assert grid.n_cells == 2
    np.testing.assert_allclose(grid.points[:, :2], points)
    np.testing.assert_allclose(grid.point_data["displacement_002"][:, :2], u[1])
    assert grid.point_data["boundary"].tolist() == [1, 2, 2, 1]
