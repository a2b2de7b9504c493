"""Failed points: left out, the gap closed, holes and edges kept, too many refused."""

from __future__ import annotations

import numpy as np
import pytest
from small_sheet import grid, stretched

from calibrate import errors
from calibrate.data.experiment import LoadedBoundary
from calibrate.data.points import drop_points, failed_points
from calibrate.data.triangulation import boundary_nodes, signed_areas


def big():
    points, triangles, number = grid(21, 19, 1.0)
    u = np.stack([0.1 * points, 0.2 * points])
    loaded = (
        LoadedBoundary("bottom", number[0], -np.ones((2, 2))),
        LoadedBoundary("top", number[-1], np.ones((2, 2))),
    )
    free = np.concatenate([number[1:-1, 0], number[1:-1, -1]])
    return points, triangles, u, loaded, free, number


def with_hole():
    """The same sheet with a square hole of 4 x 4 pitches around its centre."""
    points, triangles, u, loaded, free, number = big()
    centre = points[triangles].mean(axis=1)
    triangles = triangles[(np.abs(centre - [10.0, 9.0]) > 2.0).any(axis=1)]
    used = np.unique(triangles)
    new = np.full(len(points), -1)
    new[used] = np.arange(used.size)
    moved = tuple(LoadedBoundary(b.name, new[b.nodes], b.force) for b in loaded)
    return points[used], new[triangles], u[:, used], moved, new[free], new[number]


def area(points, triangles):
    return signed_areas(points, triangles).sum()


def test_nothing_failed_nothing_changes():
    points, triangles, u, loaded, free, _ = big()
    kept = drop_points(points, triangles, u, loaded, free)
    assert kept.lost.size == 0
    assert kept.triangles is triangles
    assert kept.points is points


def test_inner_points_are_bridged():
    points, triangles, u, loaded, free, number = big()
    failed = np.concatenate([number[5:8, 4:7].ravel(), number[12, 10:13]])
    u[1, failed] = np.nan
    assert failed_points(u).tolist() == sorted(failed)
    kept = drop_points(points, triangles, u, loaded, free)
    assert kept.lost.tolist() == sorted(failed)
    assert np.isfinite(kept.displacements).all()
    assert area(kept.points, kept.triangles) == pytest.approx(20 * 18, rel=1e-12)
    assert (signed_areas(kept.points, kept.triangles) > 0).all()
    assert np.unique(kept.triangles).size == len(kept.points)
    np.testing.assert_array_equal(kept.points, points[kept.indices])
    np.testing.assert_array_equal(kept.points[kept.loaded[1].nodes], points[loaded[1].nodes])
    assert kept.free_nodes.size == free.size


def test_holes_stay_open():
    points, triangles, u, loaded, free, number = with_hole()
    rim = np.intersect1d(boundary_nodes(triangles), number[7:12, 8:13].ravel())
    assert area(points, triangles) == pytest.approx(20 * 18 - 16)
    inner = number[4, 5:8]
    u[0, inner] = np.nan
    kept = drop_points(points, triangles, u, loaded, free)
    assert area(kept.points, kept.triangles) == pytest.approx(20 * 18 - 16, rel=1e-12)
    # a point on the straight rim of the hole: its neighbours close the rim
    on_side = rim[np.argmin(np.linalg.norm(points[rim] - [10.0, 11.0], axis=1))]
    u[1, on_side] = np.nan
    kept = drop_points(points, triangles, u, loaded, free)
    assert area(kept.points, kept.triangles) == pytest.approx(20 * 18 - 16, rel=1e-12)


def ring():
    """Three circles of 24 points, radii 4, 5, 6."""
    theta = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    points = np.concatenate([r * np.stack([np.cos(theta), np.sin(theta)], 1) for r in (4.0, 5.0, 6.0)])
    first = np.arange(24)
    triangles = []
    for k in (0, 24):
        a, b, c, d = first + k, np.roll(first, -1) + k, np.roll(first, -1) + k + 24, first + k + 24
        triangles += [np.stack([a, c, b], 1), np.stack([a, d, c], 1)]
    triangles = np.concatenate(triangles)
    return points, np.where((signed_areas(points, triangles) < 0)[:, None], triangles[:, ::-1], triangles)


def test_round_hole_loses_a_rim_point():
    points, triangles = ring()
    u = np.zeros((1, 72, 2))
    u[0, 5] = np.nan
    kept = drop_points(points, triangles, u)
    assert len(kept.points) == 71
    assert area(kept.points, kept.triangles) == pytest.approx(area(points, triangles), rel=0.02)
    assert not (np.linalg.norm(kept.points[kept.triangles].mean(axis=1), axis=1) < 3.8).any()


def test_free_edge_point_is_left_out_of_the_free_nodes():
    points, triangles, u, loaded, free, number = big()
    u[0, number[9, 0]] = np.nan
    kept = drop_points(points, triangles, u, loaded, free)
    assert area(kept.points, kept.triangles) == pytest.approx(20 * 18, rel=1e-12)
    assert kept.free_nodes.size == free.size - 1


def test_more_than_a_fifth_lost_is_refused():
    points, triangles, u, loaded, free, number = big()
    u[0, number[3:13, 2:12].ravel()] = np.nan
    with pytest.raises(errors.LostPointsError, match="100 of 399"):
        drop_points(points, triangles, u, loaded, free)


def test_loaded_edge_is_refused():
    points, triangles, u, loaded, free, number = big()
    u[0, number[-1, 7]] = np.nan
    with pytest.raises(errors.LostPointsError, match=r"loaded edge 'top', the first at \(7, 18\) mm"):
        drop_points(points, triangles, u, loaded, free)


def test_too_much_edge_lost_is_refused():
    points, triangles = ring()
    u = np.zeros((1, 72, 2))
    u[0, 48:62] = np.nan
    with pytest.raises(errors.LostPointsError, match="area"):
        drop_points(points, triangles, u)


def test_listed_points_and_the_way_to_an_experiment():
    sheet = stretched()
    kept = drop_points(
        sheet.points,
        sheet.triangles,
        sheet.displacements,
        sheet.loaded,
        sheet.free_nodes,
        failed=np.array([14]),
    )
    again = stretched(
        points=kept.points,
        triangles=kept.triangles,
        displacements=kept.displacements,
        loaded=kept.loaded,
        free_nodes=kept.free_nodes,
    )
    assert len(again.points) == 29
