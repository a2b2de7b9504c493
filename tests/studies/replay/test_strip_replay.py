"""Free edges that the camera does not see: the replay has them, at the width that a model states, and its rows know how they depend on it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibrate.data.experiment import Experiment, Noise
from calibrate.data.triangulation import boundary_edges, signed_areas
from calibrate.diagnosis import base_fit
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.equations.basis import SingleBasis
from calibrate.equations.equilibrium import neo_hooke as neo_hooke_coefficients
from calibrate.models.extended_model import ExtendedModel
from forward.loading import Loading
from forward.materials import ArrudaBoyce
from forward.sheet.plane_stress import solve
from meshes import quads, triangles
from meshes.errors import MeshDataError
from meshes.known_specimens import SPECIMENS
from meshes.measured.strip import with_strip
from studies.replay.compared_test import ComparedTest, ReplayedModel
from studies.replay.model_law import law_of, material_law
from studies.replay.replayed_experiment import BoundaryValues, Seen, named_edges, replay
from studies.synthetic import camera
from studies.synthetic.correlation_disturbances import UnmeasuredStrip

PLATE = SPECIMENS["plate_with_hole"]()
STRIP = next(effect for effect in CATALOGUE if effect.name == "unmeasured strip")


@cache
def solution():
    return solve(
        quads(PLATE, quarter=True, size_factor=0.5), ArrudaBoyce(), Loading.clamped(PLATE.loaded, 20.0), 2
    ).mirrored()


@cache
def seen(width: float, nodes: int = 500) -> Experiment:
    """The plate by a camera whose points end `width` mm before the free edges, the hole among them."""
    mesh = triangles(PLATE, n_nodes=nodes)
    return camera.observe(solution(), replace(mesh, points=UnmeasuredStrip(width).points(mesh)), name="cut")


@pytest.mark.parametrize("width", [0.3, 0.8])
def test_the_true_law_meets_a_test_whose_edges_are_not_seen(width):
    """Without the strip it misses forces by its share of the section, and displacements around the hole."""
    test = seen(width)
    law = material_law(ArrudaBoyce(), "", test)
    without, found = (replay(test, replace(law, strip=w), check_mesh=False) for w in (0.0, width))
    assert without.force_error > 0.015 and found.force_error < 3e-4
    assert found.field_error[-1] < 0.03 * without.field_error[-1]
    assert np.isfinite(found.displacements).all() and found.displacements.shape == test.displacements.shape


def test_a_grown_outline_is_that_of_the_specimen():
    """Area and free edges are those of the mesh that the camera was cut from, but for the smooth shift of its inner points; grips span the whole section."""
    test, whole = seen(0.8), camera.observe(solution(), triangles(PLATE, n_nodes=500), name="whole")
    grown, known = Seen.of(test, 0.8), Seen.of(whole)
    area = lambda one: 0.5 * np.abs(np.linalg.det(np.diff(one.points[one.triangles], axis=1))).sum()  # noqa: E731
    assert area(grown) == pytest.approx(area(known), rel=1e-3) and area(Seen.of(test)) < 0.97 * area(known)
    for name in ("left", "right"):
        ends = [np.ptp(one.points[one.edges[name]][..., 1]) for one in (grown, known)]
        assert ends[0] == pytest.approx(ends[1], rel=1e-6)
    held = BoundaryValues.of(test, strip=0.8)
    assert (~held.judged[: len(test.points)]).sum() == (~BoundaryValues.of(test).judged[: len(test.points)]).sum()
    np.testing.assert_allclose(held.carried.sum(axis=1), 1.0)
    assert Seen.of(test, 0.0).edges.keys() == named_edges(test).keys()


def test_a_strip_too_wide_for_a_hole_is_named():
    test = seen(0.3)
    with pytest.raises(MeshDataError, match=r"a strip of 40 mm .* folds at \("):
        BoundaryValues.of(test, strip=40.0)


def test_a_corner_goes_on_along_its_other_edge():
    """A square with one free side whose neighbours lean outwards."""
    points = np.array([[0.0, 0.0], [2.0, 0.0], [3.0, 1.0], [-1.0, 1.0]])
    found = with_strip(points, np.array([[0, 1, 2], [0, 2, 3]]), np.array([[0, 1]]), np.array([[1, 2], [2, 3], [3, 0]]), 0.5)  # fmt: skip
    np.testing.assert_allclose(found.points[4:], [[0.5, -0.5], [1.5, -0.5]], atol=1e-12)
    assert found.ends.tolist() == [[0, 4], [1, 5]] and found.beside.tolist() == [2, 0]
    flat = np.array([[0.0, 0.0], [2.0, 0.0], [4.0, 0.0], [2.0, 3.0]])  # one half of a side is free
    found = with_strip(flat, np.array([[0, 1, 3], [1, 2, 3]]), np.array([[0, 1]]), np.array([[1, 2], [2, 3], [3, 0]]), 0.5)  # fmt: skip
    np.testing.assert_allclose(found.points[5], [2.0, -0.5], atol=1e-12)


def test_a_strip_beside_a_staircase_is_narrower_at_its_corners():
    """Of a hole in a grid, 1 mm apart: strips beside its re-entrant corners meet from 0.5 mm on, and are made narrower there; none is turned inside out."""
    x, y = (v.ravel() for v in np.meshgrid(np.arange(8.0), np.arange(8.0)))
    grid = np.column_stack([x, y])
    corners = np.array([(k, k + 1, k + 9, k + 8) for k in range(55) if k % 8 != 7])
    cells = corners[np.hypot(*(grid[corners].mean(axis=1) - 3.5).T) > 2.2]
    faces = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    edges = boundary_edges(faces)[0]
    hole = np.abs(grid[edges].mean(axis=1) - 3.5).max(axis=1) < 3
    for width in (0.3, 0.6):
        found = with_strip(grid, faces, edges[hole], edges[~hole], width)
        assert (signed_areas(found.points, found.triangles) > 0).all()
        grown = signed_areas(found.points, found.triangles).sum() - signed_areas(grid, faces).sum()
        length = np.linalg.norm(np.diff(grid[edges[hole]], axis=1), axis=-1).sum()
        assert 0.5 * width * length < grown < width * length  # around a hole it is shorter than the edge


def test_a_model_with_a_strip_is_solved_with_it():
    basis = SingleBasis(0, 20.0)
    additions = (Addition(STRIP, (0.6,), ()),)
    test = seen(0.3)
    model = ExtendedModel(basis, neo_hooke_coefficients(basis, 0.2), additions, ((0.0,),), "MPa",
                          ({"name": test.name, "fingerprint": test.fingerprint},))  # fmt: skip
    law = law_of(model, test)
    assert law.strip == 0.6 and law.effects == ("unmeasured strip",) and not law.left_out
    other = law_of(model, replace(test, name="other", displacements=1.01 * test.displacements))
    assert other.strip == 0.0 and other.left_out == ("unmeasured strip",)  # of another specimen's picture


def test_rows_depend_on_the_width_as_replays_do():
    """Forces to a tenth, fields to a third: the strip of the rows is that of the formula, continued in a straight line, and their virtual fields end where the camera does."""
    test = replace(seen(0.8), noise=Noise(3e-3, 2.0, 5e-4, 1e-3))
    problem, fit = base_fit.prepare([test], [HoldOut("every", 2).training])
    compared = ComparedTest(problem.parts[0])
    before, after = ((Addition(STRIP, (w,), ()),) for w in (0.8, 0.88))
    rows, changes = compared.replayed(ReplayedModel(fit.c, before), True)
    expected = compared.replayed(ReplayedModel(fit.c, after), False)[0].replayed - rows.replayed
    wrong = changes.of(changes.stress(fit.c, after) - changes.stress(fit.c, before)) - expected
    is_force = compared.layout.is_force
    assert np.linalg.norm(wrong[:, is_force]) < 0.1 * np.linalg.norm(expected[:, is_force])
    assert np.linalg.norm(wrong[:, ~is_force]) < 0.35 * np.linalg.norm(expected[:, ~is_force])
