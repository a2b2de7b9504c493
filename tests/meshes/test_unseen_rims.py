"""Rims of holes beyond a grid of points: what is continued, what is closed, what is fitted, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import Delaunay

from meshes import Cross, triangles
from meshes.errors import MeshDataError
from meshes.measured.unseen_rims import (
    distance_beyond,
    fitted_hole,
    is_staircase,
    on_rim,
    openings,
    spacing,
    with_rims,
)
from meshes.mesh import boundary_edges
from meshes.shapes import Ellipse, polygon_area

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
        found = fitted_hole(points[openings(points, cells)[0]], spacing(points))
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


def test_holes_that_are_not_there_are_refused():
    points, cells = grid(ROUND)
    with pytest.raises(MeshDataError, match=r"hole at \(-10, 0\) mm: no opening"):
        with_rims(points, cells, [Ellipse(-10.0, 0.0, 1.0, 1.0)], NONE)
    with pytest.raises(
        MeshDataError, match=r"[0-9]+ measured points lie where nothing is left, the furthest at .* mm beyond"
    ):
        with_rims(points, cells, [Ellipse(0.3, -0.2, 8.0, 8.0)], NONE)
