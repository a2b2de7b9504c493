"""Extruded hexes: volume, layers, names and places of boundaries, orientation, shape functions, bad input."""

import dataclasses

import numpy as np
import pytest
from solid_helpers import block, grid

from meshes import Cross, Mesh, PlateWithHole, SolidMesh, Strip, extrude, quads, triangles
from meshes.errors import MeshDataError, MeshQualityError
from meshes.extrusion import HEX_NODES, hex_shape_gradients, hex_shapes
from meshes.mesh import boundary_edges

SPECIMENS = [Cross(), PlateWithHole(), Strip()]


@pytest.fixture(scope="module", params=SPECIMENS, ids=[s.name for s in SPECIMENS])
def specimen(request):
    return request.param


@pytest.fixture(scope="module")
def eighth(specimen):
    return extrude(quads(specimen, quarter=True, size_factor=3.0), 12.0, 3)


def jacobians(mesh, local):
    return np.einsum("qnk,mni->mqik", hex_shape_gradients(local), mesh.points[mesh.cells])


def test_volume(specimen, eighth):
    """Equal to area times height, by the hexes' own integration too; 0.1 % from the specimen's exact volume."""
    x, w = np.polynomial.legendre.leggauss(3)
    local = np.array([(a, b, c) for c in x for b in x for a in x])
    weights = np.einsum("c,b,a->cba", w, w, w).ravel()
    by_hexes = (np.linalg.det(jacobians(eighth, local)) @ weights).sum()
    assert by_hexes == pytest.approx(6.0 * eighth.plane.area(), rel=1e-12)
    assert eighth.volume() == pytest.approx(by_hexes, rel=1e-12)
    assert 8 * eighth.volume() == pytest.approx(12.0 * specimen.exact_area(), rel=1e-3)
    whole = extrude(quads(specimen, size_factor=3.0), 12.0, 1, whole=True)
    assert whole.volume() == pytest.approx(12.0 * specimen.exact_area(), rel=1e-3)


def test_positive_jacobians_at_all_nodes(eighth):
    assert np.linalg.det(jacobians(eighth, HEX_NODES)).min() > 0


def test_surface_nodes_are_those_of_the_plane_mesh(eighth):
    n = len(eighth.plane.points)
    np.testing.assert_array_equal(eighth.points[-n:, :2], eighth.plane.points)
    np.testing.assert_array_equal(eighth.points[-n:, 2], 6.0)
    np.testing.assert_array_equal(eighth.boundary_nodes("surface"), np.arange(len(eighth.points))[-n:])
    assert len(eighth.points) == 7 * n
    assert len(np.unique(eighth.cells)) == len(eighth.points)


def test_layers_thin_out_towards_the_surface():
    mesh = extrude(grid((1, 1), (1.0, 1.0)), 7.0, 3, grading=0.5)
    np.testing.assert_allclose(mesh.levels, [0, 1, 2, 2.5, 3, 3.25, 3.5])
    assert (mesh.layers, mesh.thickness, mesh.symmetric) == (3, 7.0, True)
    np.testing.assert_allclose(mesh.aspect, [2.0, 1.0, 0.5])
    whole = extrude(grid((1, 1), (1.0, 1.0)), 7.0, 3, whole=True, grading=0.5)
    np.testing.assert_allclose(whole.levels, [*-mesh.levels[:0:-1], *mesh.levels])
    assert (whole.layers, whole.thickness, whole.symmetric) == (6, 7.0, False)


def test_boundaries_lie_where_their_names_say(specimen, eighth):
    width, height = specimen.half_extent
    where = {"symmetry_x": (0, 0.0), "symmetry_y": (1, 0.0), "symmetry_z": (2, 0.0), "surface": (2, 6.0)}
    where |= {"right": (0, width), "top": (1, height)}
    for name, (axis, value) in where.items():
        nodes = eighth.boundary_nodes(name)
        np.testing.assert_allclose(eighth.points[nodes, axis], value, atol=1e-9, err_msg=name)
        rest = np.delete(eighth.points[:, axis], nodes)
        assert np.abs(rest - value).min() > 1e-3, name
    whole = extrude(quads(specimen, size_factor=4.0), 12.0, 1, whole=True)
    np.testing.assert_array_equal(whole.points[whole.boundary_nodes("back"), 2], -6.0)
    assert "symmetry_z" not in whole.boundaries


def test_boundaries_cover_the_outside_once(specimen, eighth):
    """Every face that belongs to one hex only is in one of the boundaries, and no other face is."""
    corners = np.array(
        [[0, 1, 2, 3], [18, 19, 20, 21], *([i, (i + 1) % 4, 18 + (i + 1) % 4, 18 + i] for i in range(4))]
    )
    faces = np.sort(eighth.cells[:, corners].reshape(-1, 4))
    unique, count = np.unique(faces, axis=0, return_counts=True)
    names = [*(set(specimen.loaded) & set(eighth.boundaries)), "free"]
    names += ["symmetry_x", "symmetry_y", "symmetry_z", "surface"]
    ends = {"symmetry_z": [0, 1, 2, 3], "surface": [0, 1, 2, 3]}
    named = np.concatenate([eighth.boundaries[name][:, ends.get(name, [0, 1, 6, 7])] for name in names])
    assert count.max() == 2
    assert sorted(map(tuple, np.sort(named).tolist())) == sorted(map(tuple, unique[count == 1].tolist()))
    assert len(boundary_edges(eighth.plane.cells, "quad")[0]) * eighth.layers == len(named) - 2 * len(
        eighth.plane.cells
    )


def test_rims_are_second_order_curves(specimen, eighth):
    """All nodes of a rim, the middle ones too and at each level, lie on the exact ellipse."""
    rims = [name for name in eighth.boundaries if name.startswith("hole_")]
    whole = extrude(quads(specimen, size_factor=4.0), 12.0, 1, whole=True)
    assert {name for name in whole.boundaries if name.startswith("hole_")} == {
        f"hole_{i}" for i in range(len(specimen.holes()))
    }
    assert bool(rims) == bool(specimen.holes())
    for mesh in (eighth, whole):
        for name in (name for name in mesh.boundaries if name.startswith("hole_")):
            hole, points = specimen.holes()[int(name.removeprefix("hole_"))], mesh.points[mesh.boundary_nodes(name)]
            np.testing.assert_allclose(hole.level(points[:, :2]), 1, atol=1e-9)
            np.testing.assert_array_equal(np.unique(points[:, 2]), mesh.levels)


def test_shape_functions():
    np.testing.assert_allclose(hex_shapes(HEX_NODES), np.eye(27), atol=1e-15)
    at, step = np.random.default_rng(0).uniform(-1, 1, (5, 3)), 1e-6
    for axis, e in enumerate(step * np.eye(3)):
        slope = (hex_shapes(at + e) - hex_shapes(at - e)) / (2 * step)
        np.testing.assert_allclose(hex_shape_gradients(at)[..., axis], slope, atol=1e-9)


def test_nodes_are_in_the_order_of_the_shape_functions():
    """On a straight block a triquadratic polynomial of x, y, z and its gradient are met exactly in every hex."""
    mesh = block((3, 2), 2, ragged=0.0)
    c = np.random.default_rng(1).uniform(-1, 1, (3, 3, 3))
    local = np.random.default_rng(2).uniform(-1, 1, (6, 3))
    nodal = np.polynomial.polynomial.polyval3d(*mesh.points.T, c)[mesh.cells]
    places = np.einsum("qn,mni->mqi", hex_shapes(local), mesh.points[mesh.cells])
    exact = np.polynomial.polynomial.polyval3d(*np.moveaxis(places, -1, 0), c)
    np.testing.assert_allclose(nodal @ hex_shapes(local).T, exact, atol=1e-12)
    slopes = np.einsum("qnk,mqkj->mqnj", hex_shape_gradients(local), np.linalg.inv(jacobians(mesh, local)))
    for axis in range(3):
        derivative = np.polynomial.polynomial.polyder(c, axis=axis)
        slope = np.polynomial.polynomial.polyval3d(*np.moveaxis(places, -1, 0), derivative)
        np.testing.assert_allclose(np.einsum("mn,mqn->mq", nodal, slopes[..., axis]), slope, atol=1e-11)


def test_faces_are_in_the_order_of_a_quad():
    """The nine nodes of a face span it: its corners first, its middle last."""
    mesh = block((2, 2), 2, ragged=0.0)
    for name in ("surface", "symmetry_z"):
        faces = mesh.points[mesh.boundaries[name]]
        np.testing.assert_allclose(faces[:, :4].mean(axis=1), faces[:, 8], atol=1e-12)
    for name in ("right", "top", "symmetry_x", "symmetry_y"):
        levels = mesh.points[mesh.boundaries[name]].reshape(-1, 3, 3, 3)
        np.testing.assert_allclose(levels[:, :, :2].mean(axis=2), levels[:, :, 2], atol=1e-12)
        np.testing.assert_allclose(levels[:, [0, 2]].mean(axis=1), levels[:, 1], atol=1e-12)


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_wrong_thickness(value):
    with pytest.raises(MeshDataError, match="thickness"):
        extrude(grid((1, 1), (1.0, 1.0)), value, 2)


PLANE = grid((1, 1), (1.0, 1.0))


@pytest.mark.parametrize(
    ("make", "key"),
    [
        (lambda: extrude(PLANE, 1.0, 0), "0 layers"),
        *((lambda g=g: extrude(PLANE, 1.0, 2, grading=g), "grading") for g in (0.0, 6.0, np.nan)),
        (lambda: extrude(triangles(Strip(), 100), 1.0, 2), "quads"),
        *(
            (lambda z=z: SolidMesh(PLANE, np.array(z)), "levels")
            for z in ([0.0, 1.0], [0.0, 1.0, 2.0, 3.0], [0.0, 2.0, 1.0], [[0.0, 1.0, 2.0]], [0.0, np.nan, 1.0])
        ),
        (lambda: SolidMesh(PLANE, np.array([-1.0, 0.0, 1.0])), "-1 mm"),
        (lambda: extrude(PLANE, 1.0, 1).boundary_nodes("arm"), "right, top"),
    ],
)
def test_wrong_input(make, key):
    with pytest.raises(MeshDataError, match=key):
        make()


def test_cells_that_cannot_be_extruded():
    squeezed = PLANE.points.copy()
    squeezed[PLANE.cells[0, 2]] = [0.3, 0.3]
    with pytest.raises(MeshQualityError):
        extrude(dataclasses.replace(PLANE, points=squeezed), 1.0, 1)
    inverted = Mesh(PLANE.points, PLANE.cells[:, [0, 3, 2, 1, 7, 6, 5, 4, 8]], "quad", {})
    with pytest.raises(MeshQualityError, match="-1.00"):
        extrude(inverted, 1.0, 1)
