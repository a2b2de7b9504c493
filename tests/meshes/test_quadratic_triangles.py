"""Quadratic triangles of a triangulation: the same area and outline, a linear field carried exactly, named edges with their whole length."""

from __future__ import annotations

import numpy as np
import pytest

from meshes import SquareSheet, triangles
from meshes.errors import MeshDataError
from meshes.known_specimens import SPECIMENS
from meshes.measured.quadratic_triangles import CurvedEdges, split
from meshes.mesh import boundary_edges


@pytest.fixture(scope="module")
def plate():
    return triangles(SPECIMENS["plate_with_hole"](), n_nodes=300)


@pytest.mark.parametrize("finer", [0, 1, 2])
def test_area_outline_and_linear_fields_are_kept(plate, finer):
    edges = {name: plate.boundaries[name] for name in ("left", "right")}
    found = split(plate.points, plate.cells, edges, finer)
    mesh = found.mesh
    assert 4**finer * len(plate.cells) < len(mesh.cells) < 4 ** (finer + 1) * len(plate.cells)
    assert mesh.area() == pytest.approx(plate.area(), rel=1e-12)
    assert mesh.quality.min() > 0
    np.testing.assert_array_equal(mesh.points[: len(plate.points)], plate.points)
    linear = plate.points @ np.array([[0.3, -0.1], [0.2, 0.5]]) + 1.0
    expected = mesh.points @ np.array([[0.3, -0.1], [0.2, 0.5]]) + 1.0
    np.testing.assert_allclose(found.interpolation @ linear, expected, atol=1e-10)
    for name, own in edges.items():
        a, b, middle = mesh.points[mesh.boundaries[name].T]
        np.testing.assert_allclose(middle, (a + b) / 2, atol=1e-12)
        whole = np.linalg.norm(plate.points[own[:, 1]] - plate.points[own[:, 0]], axis=1).sum()
        assert np.linalg.norm(b - a, axis=1).sum() == pytest.approx(whole)


def test_every_node_is_there_once(plate):
    mesh = split(plate.points, plate.cells, {}, 0).mesh
    assert len(np.unique(mesh.cells)) == len(mesh.points)
    assert len(np.unique(np.round(mesh.points, 7), axis=0)) == len(mesh.points)
    # a node for every corner and every edge, by Euler's formula for a sheet with one hole
    m, outline = len(mesh.cells), len(boundary_edges(mesh.cells, "triangle6")[0])
    edges, corners = (3 * m + outline) // 2, len(np.unique(mesh.corners))
    assert corners - edges + m == 0
    assert len(mesh.points) == corners + edges


def test_triangles_at_the_outline_are_divided_and_their_neighbours_fit(plate):
    """No node hangs: every edge inside has two triangles. At the outline edges are half as long; far from it nothing is divided."""
    mesh = split(plate.points, plate.cells, {}).mesh
    outline = boundary_edges(mesh.cells, "triangle6")[0]
    before = boundary_edges(plate.cells, "triangle")[0]
    assert len(outline) == 2 * len(before)
    at_edge = np.isin(plate.cells, np.unique(before)).any(axis=1)
    far = ~np.isin(plate.cells, np.unique(plate.cells[at_edge])).any(axis=1)
    kept = {tuple(sorted(cell)) for cell in mesh.corners.tolist()}
    assert far.any()
    assert all(tuple(sorted(cell)) in kept for cell in plate.cells[far].tolist())
    assert mesh.quality.min() > 0.3 * plate.quality.min()


def test_an_edge_inside_is_no_outline():
    sheet = triangles(SquareSheet(), n_nodes=100)
    outline = {tuple(sorted(e)) for e in boundary_edges(sheet.cells, "triangle")[0].tolist()}
    inside = next(e for e in sheet.cells[:, :2].tolist() if tuple(sorted(e)) not in outline)
    with pytest.raises(MeshDataError, match="'grip'.*outline"):
        split(sheet.points, sheet.cells, {"grip": np.array([inside])})


@pytest.mark.parametrize("finer", [0, 1])
def test_curved_edges_are_parabolas(finer):
    """Of a square whose right side bulges by h: the area grows by 2/3 h, nodes of the side lie on the parabola, those of other sides stay."""
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    cells, h = np.array([[0, 1, 2], [0, 2, 3]]), 0.1
    curved = CurvedEdges(np.array([[1, 2]]), np.array([[h, 0.0]]))
    found = split(points, cells, {"right": np.array([[1, 2]]), "left": np.array([[3, 0]])}, finer, curved).mesh
    assert found.area() == pytest.approx(1 + 2 * h / 3, rel=1e-9)
    assert found.quality.min() > 0
    x, y = found.points[np.unique(found.boundaries["right"])].T
    np.testing.assert_allclose(x, 1 + 4 * h * y * (1 - y), atol=1e-12)
    np.testing.assert_allclose(found.points[np.unique(found.boundaries["left"]), 0], 0.0, atol=1e-12)
