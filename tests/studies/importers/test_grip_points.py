"""Points of a grip that failed follow those beside them."""

import numpy as np

from studies.importers.masking.grip_points import along_grips

POINTS = np.column_stack([np.tile([0.0, 10.0], 9), np.repeat(np.arange(9.0), 2)])
LEFT, RIGHT = np.arange(0, 18, 2), np.arange(1, 18, 2)


def rigid(frames: int = 4) -> np.ndarray:
    """The right grip moves and turns as a body, mm."""
    u = np.zeros((frames, 18, 2))
    for k in range(frames):
        u[k, RIGHT] = np.column_stack([0.5 * k + 0.02 * k * POINTS[RIGHT, 1], np.full(9, -0.1 * k)])
    return u


def test_a_body_moves_on_where_its_points_failed():
    u = rigid()
    u[1:, RIGHT[[3, 4]]] = np.nan
    made, count = along_grips(POINTS, u, [(LEFT, 1), (RIGHT[::-1], 1)])
    np.testing.assert_allclose(made, rigid(), atol=1e-12)
    assert count == 6


def test_beyond_the_last_good_point_the_motion_is_its():
    u = rigid()
    u[2, RIGHT[-1]] = np.nan
    made, _ = along_grips(POINTS, u, [(RIGHT, 1)])
    np.testing.assert_allclose(made[2, RIGHT[-1]], u[2, RIGHT[-2]])


def test_a_grip_that_failed_by_more_than_half_stays_failed():
    u = rigid()
    u[3, RIGHT[:5]] = np.nan
    made, count = along_grips(POINTS, u, [(RIGHT, 1)])
    assert count == 0 and np.isnan(made[3, RIGHT[:5]]).all()
