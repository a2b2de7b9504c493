"""Curves through points of an outline: fourth order on an ellipse, exact on straight lines, corners kept."""

from __future__ import annotations

import numpy as np
import pytest

from meshes import PlateWithHole, SquareSheet, quads, triangles
from meshes.measured import curved_outline
from meshes.measured.curved_outline import rises
from meshes.measured.quadratic_triangles import CurvedEdges, split
from meshes.mesh import boundary_edges

FAR = np.inf


def loop(n: int) -> tuple[np.ndarray, np.ndarray]:
    """n points of an ellipse twice as long as wide, and its edges."""
    t = 2 * np.pi * np.arange(n) / n
    return np.column_stack([2 * np.cos(t), np.sin(t)]), np.column_stack([np.arange(n), (np.arange(n) + 1) % n])


def evenly(n: int, first: float) -> tuple[np.ndarray, np.ndarray]:
    """The same with points at even distances along the ellipse, the first of them at a share of a distance from a tip: the tips turn by up to 80 degrees."""
    t = np.linspace(0, 2 * np.pi, 20001)
    length = np.append(0.0, np.cumsum(np.hypot(2 * np.diff(np.cos(t)), np.diff(np.sin(t)))))
    at = np.interp((np.arange(n) + first) / n * length[-1], length, t)
    return np.column_stack([2 * np.cos(at), np.sin(at)]), loop(n)[1]


def area(points: np.ndarray, edges: np.ndarray, raised: np.ndarray) -> float:
    """Within parabolas over the edges, of rises normal to them."""
    (x, y), (dx, dy) = points[edges[:, 0]].T, (points[edges[:, 1]] - points[edges[:, 0]]).T
    return float(0.5 * (x * dy - y * dx).sum() + 2 / 3 * (raised[:, 0] * dy - raised[:, 1] * dx).sum())


@pytest.mark.parametrize("first", [0.0, 0.5])
@pytest.mark.parametrize("n", [9, 10, 11, 12])
def test_tips_of_an_ellipse_of_few_points_are_no_corners(n, first):
    """Taken for corners they make a lemon of it, see below; a polygon is 5 to 9 % off."""
    points, edges = evenly(n, first)
    found = area(points, edges, rises(points, edges, np.full(n, FAR)))
    assert abs(found / (2 * np.pi) - 1) < 0.008
    assert abs(area(points, edges, np.zeros((n, 2))) / (2 * np.pi) - 1) > 0.05


def test_taken_for_corners_they_cost_up_to_a_twentieth_of_the_area(monkeypatch):
    monkeypatch.setattr(curved_outline, "BESIDE", np.inf)
    points, edges = evenly(9, 0.0)
    assert 0.04 < 1 - area(points, edges, rises(points, edges, np.full(9, FAR))) / (2 * np.pi) < 0.05


def test_a_square_hole_has_corners_however_few_points_it_has():
    for each in (1, 2, 3):
        side = np.arange(each) / each
        points = np.concatenate([np.column_stack([side, 0 * side]), np.column_stack([1 + 0 * side, side]),
                                 np.column_stack([1 - side, 1 + 0 * side]), np.column_stack([0 * side, 1 - side])])  # fmt: skip
        np.testing.assert_allclose(rises(points, loop(4 * each)[1], np.full(4 * each, FAR)), 0.0, atol=1e-12)


def off_ellipse(n: int) -> float:
    """How far the largest of the raised middles is off the ellipse, first order in the distance."""
    points, edges = loop(n)
    middle = points[edges].mean(axis=1) + rises(points, edges, np.full(n, FAR))
    return float(np.abs(np.hypot(middle[:, 0] / 2, middle[:, 1]) - 1).max())


def test_fourth_order_on_an_ellipse():
    errors = np.array([off_ellipse(n) for n in (16, 32, 64, 128)])
    assert np.log2(errors[:-1] / errors[1:]).min() > 3.5


def test_rises_are_normal_outward_and_bounded():
    points, edges = loop(24)
    found = rises(points, edges, np.full(24, 0.01))
    along = points[edges[:, 1]] - points[edges[:, 0]]
    np.testing.assert_allclose((found * along).sum(axis=1), 0.0, atol=1e-15)
    assert (found * points[edges].mean(axis=1)).sum(axis=1).min() > 0  # an anticlockwise rim bulges
    assert np.linalg.norm(found, axis=1).max() == pytest.approx(0.01)


def test_straight_edges_and_their_corners_stay():
    mesh = triangles(SquareSheet(), n_nodes=150)
    edges, _ = boundary_edges(mesh.cells, "triangle")
    np.testing.assert_allclose(rises(mesh.points, edges, np.full(len(edges), FAR)), 0.0, atol=1e-12)


def test_where_two_holes_meet_nothing_goes_on():
    points, edges = loop(12)
    other = points + [4.0, 0.0]  # touches the first at (2, 0), which is its point 6
    both = np.concatenate([points, np.delete(other, 6, axis=0)])
    number = np.where(np.arange(12) < 6, np.arange(12) + 12, np.arange(12) + 11)
    number[6] = 0
    joined = rises(both, np.concatenate([edges, number[edges]]), np.full(24, FAR))
    alone = rises(points, edges, np.full(12, FAR))
    np.testing.assert_allclose(joined[5], alone[5], rtol=0.1)
    assert np.isfinite(joined).all()


@pytest.mark.parametrize("finer", [0, 1])
def test_the_area_of_a_round_hole_is_met(finer):
    plate = PlateWithHole()
    mesh = triangles(plate, n_nodes=300)
    exact = quads_area(plate)
    edges, _ = boundary_edges(mesh.cells, "triangle")
    arcs = edges, rises(mesh.points, edges, np.full(len(edges), FAR))
    curved = split(mesh.points, mesh.cells, {}, finer, CurvedEdges(*arcs)).mesh
    assert curved.quality.min() > 0
    np.testing.assert_array_equal(curved.points[: len(mesh.points)], mesh.points)
    assert abs(curved.area() - exact) < 0.02 * abs(mesh.area() - exact)


def quads_area(plate: PlateWithHole) -> float:
    """Of a plate with the parabolas of a fine mesh."""
    return quads(plate, size_factor=0.5).area()
