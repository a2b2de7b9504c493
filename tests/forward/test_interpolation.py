"""Places in a mesh of curved triangles: the quick search finds what the general one does."""

from __future__ import annotations

import numpy as np

from forward.interpolation import in_triangles, locate, values_at
from meshes import PlateWithHole, triangles
from meshes.measured.quadratic_triangles import CurvedEdges, split
from meshes.mesh import boundary_edges

PLATE = PlateWithHole(half_length=30, half_width=15, far_size=3, hole_radius=5, hole_size=1.5)


def curved():
    """A plate with a round hole of parabolas."""
    mesh = triangles(PLATE, n_nodes=300)
    edges = boundary_edges(mesh.cells, "triangle")[0]
    middle = mesh.points[edges].mean(axis=1)
    radius = np.linalg.norm(middle, axis=1)
    round_ = radius < 5.5
    bulges = (middle * (5 / radius - 1)[:, None])[round_]
    return split(mesh.points, mesh.cells, {"outline": edges}, curved=CurvedEdges(edges[round_], bulges)).mesh


def test_the_quick_search_finds_points_inside_and_no_others():
    mesh = curved()
    points = np.random.default_rng(0).uniform([-33, -17], [33, 17], (20000, 2))
    found = in_triangles(mesh, points)
    radius, inside = np.linalg.norm(points, axis=1), found.excess == 0
    sure = np.abs(radius - 5) > 2e-3  # parabolas are no circles
    expected = (np.abs(points) < [30, 15]).all(axis=1) & (radius > 5)
    np.testing.assert_array_equal(inside[sure], expected[sure])
    np.testing.assert_allclose(values_at(mesh, found, mesh.points[None])[0][inside], points[inside], atol=1e-9)
    other = locate(mesh, points[inside])
    assert (other.excess == 0).all()
