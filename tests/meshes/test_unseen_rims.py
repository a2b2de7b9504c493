"""Rims of holes beyond a grid of points: what is continued, what is closed, what is fitted, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import Delaunay

from meshes import Cross, triangles
from meshes.errors import MeshDataError
from meshes.measured.round_openings import fitted_hole, is_staircase
from meshes.measured.unseen_rims import (
    distance_beyond,
    on_rim,
    openings,
    with_rims,
)
from meshes.mesh import boundary_edges, spacing_of
from meshes.shapes import Arc, Ellipse, Segment, polygon_area

ROUND, OBLONG = Ellipse(0.3, -0.2, 6.0, 6.0), Ellipse(-0.4, 0.3, 7.0, 4.5, 0.5)
NONE = np.zeros(0, np.int64)
HOLES = pytest.mark.parametrize("hole", [ROUND, OBLONG], ids=["circle", "ellipse"])


def grid(hole, margin=0.5, half=15):
    """Points 1 mm apart around a hole, none nearer to it than a margin, and their triangles."""
    x = np.arange(-half, half + 1.0)
    points = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    points = points[distance_beyond(hole, points) > margin]
    cells = Delaunay(points).simplices.astype(np.int64)
    a, b, c = (points[cells[:, k]] for k in range(3))
    longest = np.max([np.linalg.norm(p - q, axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    cells[twice < 0] = cells[twice < 0][:, ::-1]
    return points, cells[(longest < 2.2) & (np.abs(twice) > 1e-9)]


@HOLES
def test_the_grown_region_is_the_sheet_less_the_hole(hole):
    points, cells = grid(hole)
    found = with_rims(points, cells, [hole], NONE)
    a, b, c = (found.points[found.triangles[:, k]] for k in range(3))
    areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    rim = found.points[len(found.kept) :]
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(30.0**2 - polygon_area(rim), rel=1e-9)
    assert areas.sum() == pytest.approx(30.0**2 - hole.area, rel=1e-3)
    np.testing.assert_allclose(hole.level(rim), 1.0, atol=1e-9)
    inner = np.setdiff1d(
        boundary_edges(found.triangles, "triangle")[0], np.flatnonzero(np.abs(found.points).max(axis=1) == 15)
    )
    assert inner.min() == len(found.kept)  # nothing but the rim bounds the hole
    np.testing.assert_array_equal(found.points[: len(found.kept)], points[found.kept])


@HOLES
def test_quadratic_fields_are_continued_exactly(hole):
    points, cells = grid(hole)
    found = with_rims(points, cells, [hole], NONE)

    def field(p):
        return 1 + p @ [0.3, -0.2] + p[:, 0] ** 2 - 0.4 * p[:, 0] * p[:, 1] + 0.7 * p[:, 1] ** 2

    np.testing.assert_allclose(
        found.continued @ field(points[found.kept]), field(found.points[len(found.kept) :]), atol=1e-9
    )


def test_what_is_continued_converges_with_the_distance_of_the_points():
    errors = []
    for finer in (1.0, 2.0, 4.0):
        hole = Ellipse(0.0, 0.0, 6.0 * finer, 6.0 * finer)
        points, cells = grid(hole, half=int(15 * finer))
        found = with_rims(points, cells, [hole], NONE)

        def field(p, finer=finer):
            return p[:, 0] / finer * (1 + 36 / ((p / finer) ** 2).sum(axis=1))  # of a plate with a hole under tension

        errors.append(
            np.abs(found.continued @ field(points[found.kept]) - field(found.points[len(found.kept) :])).max()
        )
    assert errors[1] < errors[0] / 4
    assert errors[2] < errors[1] / 4


def test_the_largest_circle_between_points_is_that_of_the_hole_and_the_margin():
    rng = np.random.default_rng(5)
    for _ in range(20):
        hole = Ellipse(*rng.uniform(-1, 1, 2), *2 * [rng.uniform(4, 9)])
        points, cells = grid(hole)
        found = fitted_hole(points[openings(points, cells)[0]], spacing_of(points))
        assert found is not None
        assert np.hypot(found.x - hole.x, found.y - hole.y) < 0.35
        assert -0.01 < found.a - (hole.a + 0.5) < 0.35


def test_a_staircase_is_one_and_points_on_a_rim_are_not():
    for hole in (ROUND, OBLONG):
        points, cells = grid(hole)
        assert is_staircase(points[openings(points, cells)[0]])
        assert not is_staircase(on_rim(hole, 1.0))
    mesh = triangles(Cross(), n_nodes=1200)
    around = openings(mesh.points, mesh.cells)
    assert len(around) == 9
    assert not any(is_staircase(mesh.points[opening]) for opening in around)


def test_an_opening_that_is_not_round_is_not_fitted():
    x = np.arange(-15, 16.0)
    square = np.array(
        [(p, -6.0) for p in x[9:22]]
        + [(6.0, p) for p in x[10:22]]
        + [(p, 6.0) for p in x[20:8:-1]]
        + [(-6.0, p) for p in x[20:9:-1]]
    )
    assert fitted_hole(square, 1.0) is None


@pytest.mark.parametrize("degrees", [0.003, 0.1, 0.5])
def test_a_grid_that_is_not_quite_parallel_has_no_flat_triangles(degrees):
    """Rows that rounding has bent by a millionth of their distance."""
    points, cells = grid(ROUND)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turned = np.round(points @ [[c, s], [-s, c]], 6)
    found = with_rims(turned, cells, [Ellipse(*np.array([0.3, -0.2]) @ [[c, s], [-s, c]], 6.0, 6.0)], NONE)
    a, b, d = (found.points[found.triangles[:, k]] for k in range(3))
    areas = ((b - a)[:, 0] * (d - a)[:, 1] - (b - a)[:, 1] * (d - a)[:, 0]) / 2
    assert areas.min() > 0.01 and areas.sum() == pytest.approx(30.0**2 - ROUND.area, rel=1e-3)


def test_gaps_between_scattered_points_are_no_holes():
    rng = np.random.default_rng(2)
    for _ in range(60):
        turns = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 8))))
        gap = (
            rng.uniform(0.5, 1.2)
            * np.column_stack([np.cos(turns), np.sin(turns)])
            * rng.uniform(0.6, 1.4, (len(turns), 1))
        )
        assert fitted_hole(gap, 1.0) is None


def test_a_gauge_and_its_fillets_share_their_ends():
    """Half of a dog-bone: area of the specimen, whatever the order."""
    x, y = np.meshgrid(np.arange(-20, 20.1), np.arange(0, 12.1))
    points = np.column_stack([x.ravel(), y.ravel()])
    arcs = [Arc(10.0, 15.0, 10.0, 10.0, 0.0, np.radians(270), np.radians(330)), Arc(-10.0, 15.0, 10.0, 10.0, 0.0, np.radians(210), np.radians(270))]  # fmt: skip
    gauge = Segment((10.0, 5.0), (-10.0, 5.0))
    stays = ~((np.abs(points[:, 0]) < 10) & (points[:, 1] > 4.4))
    for arc in arcs:
        stays &= np.hypot(*(points - [arc.x, arc.y]).T) > 10.6
    stays &= points[:, 1] < 10.1
    points = points[stays & ~((np.abs(points[:, 0]) > 18.5) & (points[:, 1] > 9.9))]
    cells = Delaunay(points).simplices.astype(np.int64)
    sides = np.linalg.norm(points[cells] - np.roll(points[cells], 1, axis=1), axis=2).max(axis=1)
    a, b, c = (points[cells[:, k]] for k in range(3))
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    cells[twice < 0] = cells[twice < 0][:, ::-1]
    cells = cells[(sides < 2.2) & (np.abs(twice) > 1e-9)]
    before = with_rims(points, cells, [*arcs], NONE)
    found, other = (with_rims(points, cells, rims, NONE) for rims in ([*arcs, gauge], [gauge, *arcs]))
    total = [
        np.abs(np.linalg.det(np.diff(one.points[one.triangles], axis=1))).sum() / 2 for one in (before, found, other)
    ]
    assert total[1] == pytest.approx(total[2], rel=1e-4)
    assert total[1] - total[0] == pytest.approx(20 * 1.0, rel=0.1)


def test_a_rim_too_far_from_the_points_is_refused():
    points, cells = grid(ROUND)
    with pytest.raises(
        MeshDataError, match=r"up to 4.* distances of the points; .* over 3 at most. Is the diameter meant"
    ):
        with_rims(points, cells, [Ellipse(0.3, -0.2, 3.0, 3.0)], NONE)
    with pytest.raises(MeshDataError, match="is given twice"):
        with_rims(points, cells, [ROUND, ROUND], NONE)


def test_holes_that_are_not_there_are_refused():
    points, cells = grid(ROUND)
    with pytest.raises(MeshDataError, match=r"hole at \(-10, 0\) mm: no opening"):
        with_rims(points, cells, [Ellipse(-10.0, 0.0, 1.0, 1.0)], NONE)
    with pytest.raises(
        MeshDataError, match=r"[0-9]+ measured points lie where nothing is left, the furthest at .* mm beyond"
    ):
        with_rims(points, cells, [Ellipse(0.3, -0.2, 8.0, 8.0)], NONE)
