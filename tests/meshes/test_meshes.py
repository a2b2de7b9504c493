"""Meshes: quality, area, counts, names of boundaries, mirror images, files and the errors of bad input."""

import importlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from meshes import (
    Cross,
    Mesh,
    MeshError,
    PerforatedSheet,
    PlateWithHole,
    Strip,
    _gmsh,
    area_excess,
    known_specimens,
    quads,
    specimen_from_dict,
    triangles,
)
from meshes.elements import QUAD_NODES, quad_shape_gradients, quad_shapes
from meshes.errors import MeshDataError, MissingLibraryError, SpecimenError
from meshes.mesh import boundary_edges
from meshes.perforated_sheets import SHEETS, TTc
from meshes.picture import draw
from meshes.shapes import Ellipse

ROOT = Path(__file__).parents[2]
SPECIMENS = [kind() for kind in known_specimens.SPECIMENS.values()]
NAMES = [specimen.name for specimen in SPECIMENS]


@pytest.fixture(scope="module")
def cross():
    return quads(Cross())


def test_exact_areas():
    assert Strip(50.0, 5.0).exact_area() == pytest.approx(1000.0)
    assert PlateWithHole(50.0, 20.0, hole_radius=10.0).exact_area() == pytest.approx(4000.0 - 100 * np.pi)
    strips = 2 * 200 * 80 - 80**2
    corners = 4 * (1 - np.pi / 4) * 20**2
    assert Cross().exact_area() == pytest.approx(strips + corners - 9 * np.pi * 7.5 * 3.75)


@pytest.mark.parametrize("specimen", SPECIMENS, ids=NAMES)
@pytest.mark.parametrize("quarter", [False, True], ids=["full", "quarter"])
def test_quads(specimen, quarter):
    mesh = quads(specimen, quarter)
    assert mesh.cell_type == "quad"
    assert mesh.cells.shape[1] == 9
    assert mesh.quality.min() >= 0.3
    part = 4 if quarter else 1
    assert part * mesh.area() == pytest.approx(specimen.exact_area(), rel=1e-5)
    assert len(np.unique(mesh.cells)) == len(mesh.points)
    _check_boundaries(mesh, specimen, quarter)


@pytest.mark.parametrize("specimen", SPECIMENS, ids=NAMES)
@pytest.mark.parametrize("quarter", [False, True], ids=["full", "quarter"])
def test_triangles(specimen, quarter):
    mesh = triangles(specimen, quarter=quarter)
    assert mesh.cell_type == "triangle"
    assert mesh.quality.min() >= 0.3
    part = 4 if quarter else 1
    assert part * mesh.area() == pytest.approx(specimen.exact_area(), rel=3e-3)
    _check_boundaries(mesh, specimen, quarter)


def _check_boundaries(mesh, specimen, quarter):
    """Sides lie where their names say; loaded sides, free edges and cuts make up the whole boundary, once."""
    width, height = specimen.half_extent
    places = {"right": (0, width), "left": (0, -width), "top": (1, height), "bottom": (1, -height)}
    places |= {"symmetry_x": (0, 0.0), "symmetry_y": (1, 0.0)}
    for name, (axis, value) in places.items():
        if name in mesh.boundaries:
            np.testing.assert_allclose(mesh.points[mesh.boundary_nodes(name), axis], value, atol=1e-9)
    sides = {"right", "top"} if quarter else {"left", "right", "bottom", "top"}
    assert sides <= set(mesh.boundaries)
    assert {"symmetry_x", "symmetry_y"} <= set(mesh.boundaries) or not quarter
    names = [*(sides & set(specimen.loaded)), "free", *(["symmetry_x", "symmetry_y"] if quarter else [])]
    edges = np.concatenate([mesh.boundaries[name] for name in names])
    whole, _ = boundary_edges(mesh.cells, mesh.cell_type)
    assert sorted(map(tuple, edges.tolist())) == sorted(map(tuple, whole.tolist()))
    rims = {name for name in mesh.boundaries if name.startswith("hole_")}
    if not quarter:
        assert rims == {f"hole_{i}" for i in range(len(specimen.holes()))}
    for name in rims:
        hole = specimen.holes()[int(name.removeprefix("hole_"))]
        np.testing.assert_allclose(hole.level(mesh.points[mesh.boundary_nodes(name)]), 1, atol=1e-9)


def test_counts(cross):
    """The default cross is the one the numbers in the documentation are about."""
    assert 2000 < len(cross.cells) < 2600
    assert len(quads(Cross(), size_factor=2.0).cells) < 0.7 * len(cross.cells)
    assert {len(cross.boundaries[f"hole_{i}"]) for i in range(9)} <= set(range(26, 40))


def test_grading(cross):
    """Edges at the rims are about hole_size long, those of the arm ends about far_size."""

    def length(name):
        return np.linalg.norm(np.diff(cross.points[cross.boundaries[name][:, :2]], axis=1), axis=2).mean()

    assert length("hole_0") == pytest.approx(1.2, rel=0.2)
    assert length("right") == pytest.approx(5.0, rel=0.3)


@pytest.mark.parametrize("size_factor", [0.5, 0.8, 1.5, 2.0, 3.0, 5.0])
def test_quality_at_other_sizes(size_factor):
    assert quads(Cross(), True, size_factor).quality.min() >= 0.3


@pytest.mark.parametrize("n_nodes", [600, 2500, 5000])
def test_target_number_of_nodes(n_nodes):
    mesh = triangles(Cross(), n_nodes)
    assert abs(len(mesh.points) / n_nodes - 1) <= 0.05
    assert 0 < area_excess(mesh, Cross()) < 10 / n_nodes
    assert mesh.quality.min() >= 0.3


def test_same_mesh_every_time():
    np.testing.assert_array_equal(triangles(Cross(), 600).points, triangles(Cross(), 600).points)


@pytest.mark.parametrize("make", [quads, triangles])
def test_mirror(make):
    quarter = make(PlateWithHole(), quarter=True)
    full, source, signs = quarter.mirrored()
    np.testing.assert_allclose(full.points, quarter.points[source] * signs, atol=1e-12)
    assert len(full.cells) == 4 * len(quarter.cells)
    assert full.quality.min() == pytest.approx(quarter.quality.min())
    assert full.area() == pytest.approx(4 * quarter.area())
    rounded = {tuple(p) for p in np.round(full.points, 6) + 0.0}
    assert len(rounded) == len(full.points)
    assert {(-x + 0.0, y) for x, y in rounded} == rounded == {(x, -y + 0.0) for x, y in rounded}
    with pytest.raises(MeshDataError, match="only a quarter"):
        full.mirrored()


def test_boundary_edges_run_around_the_cells(cross):
    """Free edges keep the material on their left: the signed area inside the rims is negative."""
    for name, sign in (("hole_0", -1), ("hole_5", -1)):
        a, b = np.moveaxis(cross.points[cross.boundaries[name][:, :2]], 1, 0)
        assert sign * (a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]).sum() > 0


def test_shape_functions():
    np.testing.assert_allclose(quad_shapes(QUAD_NODES), np.eye(9), atol=1e-15)
    at = np.random.default_rng(0).uniform(-1, 1, (5, 2))
    step = 1e-6 * np.eye(2)
    for axis in range(2):
        slope = (quad_shapes(at + step[axis]) - quad_shapes(at - step[axis])) / 2e-6
        np.testing.assert_allclose(quad_shape_gradients(at)[..., axis], slope, atol=1e-9)


def test_quality_of_known_cells():
    points = np.array([[0, 0], [1, 0], [0.5, np.sqrt(3) / 2], [1.0, 1.0]])
    mesh = Mesh(points, np.array([[0, 1, 2], [0, 1, 3], [0, 2, 1]]), "triangle", {})
    np.testing.assert_allclose(mesh.quality, [1.0, np.sqrt(3) / 2, -1.0])
    assert Mesh(2 + 3 * QUAD_NODES, np.arange(9)[None], "quad", {}).quality[0] == pytest.approx(1)


def test_file(cross, tmp_path):
    path = tmp_path / "new" / "mesh.npz"
    cross.save(path)
    copy = Mesh.load(path)
    np.testing.assert_array_equal(copy.points, cross.points)
    assert copy.boundaries.keys() == cross.boundaries.keys()
    with pytest.raises(MeshDataError, match="below_a_file.npz"):
        cross.save(path / "below_a_file.npz")
    path.write_bytes(b"PK something else")
    for wrong in (path, tmp_path / "missing.npz"):
        with pytest.raises(MeshDataError, match=wrong.name):
            Mesh.load(wrong)
    for content, key in (("other", "equigap-mesh"), ("equigap-mesh", "cells, cell_type")):
        np.savez(path, format=content, version=1, points=cross.points)
        with pytest.raises(MeshDataError, match=key):
            Mesh.load(path)


@pytest.mark.parametrize("specimen", SPECIMENS, ids=NAMES)
def test_picture(specimen, tmp_path):
    for make in (quads, triangles):
        draw(make(specimen), tmp_path / "mesh.png")
        assert (tmp_path / "mesh.png").stat().st_size > 10_000


@pytest.mark.parametrize("specimen", SPECIMENS, ids=NAMES)
def test_dictionary(specimen):
    assert specimen_from_dict(specimen.to_dict()) == specimen
    assert set(quads(specimen).boundaries) == set(specimen.boundaries)


@pytest.mark.parametrize(
    ("make", "key"),
    [
        (lambda: Cross(half_length=-1.0), "half_length = -1.0"),
        (lambda: Cross(half_length=float("nan")), "half_length = nan"),
        (lambda: Strip(half_width="wide"), "half_width = wide"),
        (lambda: Cross(half_width=120.0), "half_width"),
        (lambda: Cross(fillet_radius=61.0), "fillet"),
        (lambda: Cross(hole_semi_major=3.0), "swap"),
        (lambda: Cross(hole_size=8.0), "hole_size"),
        (lambda: Cross(inner_offset=8.0), "overlap"),
        (lambda: Cross(outer_offset=98.0), "outline"),
        (lambda: Cross(half_width=18.0, fillet_radius=5.0), "outline"),
        (lambda: PlateWithHole(hole_radius=35.0), "outline"),
        (lambda: PerforatedSheet(perforation=(Ellipse(-5.0, 0.0, 2.0, 2.0),)), "mirrored"),
        (lambda: PerforatedSheet(perforation=(Ellipse(0.0, 0.0, 2.0, 3.0),)), "a >= b"),
        (lambda: PerforatedSheet(perforation=(Ellipse(5.0, 0.0, 3.0, 2.0, 0.5),)), "symmetry"),
        (lambda: PerforatedSheet(perforation=(Ellipse(0.0, 13.0, 2.0, 2.0),)), "outline"),
        (lambda: specimen_from_dict({"specimen": "ring"}), "cross, strip"),
        (lambda: specimen_from_dict({"specimen": "strip", "length": 3.0}), "length"),
    ],
)
def test_impossible_specimens(make, key):
    with pytest.raises(SpecimenError, match=key):
        make()


def test_holes_of_a_perforated_sheet_are_mirrored():
    """A hole off both axes is there four times, one on an axis twice, one in the middle once."""
    holes = PerforatedSheet(perforation=(Ellipse(20, 7, 4, 2, 0.5), Ellipse(0, 8, 3, 2), Ellipse(0, 0, 3, 3))).holes()
    assert len(holes) == 4 + 2 + 1
    for axis in (0, 1):
        flip = np.where(np.arange(2) == axis, -1.0, 1.0)
        for hole in holes:
            images = [other for other in holes if np.allclose(other.level(hole.rim() * flip), 1)]
            assert len(images) == 1


def test_sheets_are_as_wide_as_said():
    assert {kind.name: 2 * kind().half_extent[1] for kind in SHEETS if kind().loaded[0] == "left"} == dict.fromkeys(
        ("UT", "TTa", "TTb", "TTc", "TTd", "TTe", "TTf"), 30.0
    )
    assert TTc().exact_area() == pytest.approx(60 * 30 - np.pi * 27)


@pytest.mark.parametrize(
    ("make", "key"),
    [
        (lambda cross: quads(Cross(), size_factor=-1.0), "size_factor = -1"),
        (lambda cross: triangles(Cross(), 5), "20"),
        (lambda cross: cross.boundary_nodes("arm"), "right"),
        (lambda cross: Mesh(cross.points, cross.cells, "hexagon", {}), "'triangle', 'triangle6', 'quad'"),
        (lambda cross: Mesh(cross.points * np.nan, cross.cells, "quad", {}), "finite"),
        (lambda cross: Mesh(cross.points, cross.cells, "triangle", {}), "3 nodes"),
        (lambda cross: Mesh(cross.points[:-1], cross.cells, "quad", {}), "cells"),
        (lambda cross: Mesh(cross.points, cross.cells, "quad", {"free": np.array([[0, 1, -5]])}), "free"),
    ],
)
def test_impossible_meshes(cross, make, key):
    with pytest.raises(MeshDataError, match=key):
        make(cross)


def test_a_specimen_that_cannot_be_meshed_so_coarsely_is_named():
    with pytest.raises(MeshError, match="cross"):
        triangles(Cross(), 60)


def test_missing_libraries_are_named(monkeypatch):
    def without_glu(name):
        raise OSError("libGLU.so.1: cannot open shared object file: No such file or directory")

    def without_gmsh(name):
        raise ModuleNotFoundError("No module named 'gmsh'")

    monkeypatch.setattr(importlib, "import_module", without_glu)
    with pytest.raises(MissingLibraryError, match=r"libGLU\.so\.1.*apt-get install .*libglu1-mesa"):
        _gmsh.load()
    monkeypatch.setattr(importlib, "import_module", without_gmsh)
    with pytest.raises(MissingLibraryError, match="make setup"):
        quads(Strip())


def test_a_library_that_cannot_be_loaded(tmp_path):
    """The real loader, with a broken libGLU before the sound one."""
    (tmp_path / "libGLU.so.1").touch()
    command = "from meshes import Strip, quads; quads(Strip())"
    environment = {**os.environ, "LD_LIBRARY_PATH": str(tmp_path), "PYTHONPATH": str(ROOT)}
    run = subprocess.run([sys.executable, "-c", command], env=environment, capture_output=True, text=True, check=False)
    assert run.returncode != 0
    assert "MissingLibraryError" in run.stderr
    assert "libglu1-mesa" in run.stderr


def test_gmsh_needs_no_screen(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    assert len(quads(Strip(far_size=10.0)).cells) > 0
