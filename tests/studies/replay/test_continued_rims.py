"""Holes whose rims a grid of points does not reach: in the equations and in a replay, by the true law of another discretisation."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial import Delaunay

from calibrate.data.continued_rims import WithRims, with_continued_rims
from calibrate.data.experiment import Experiment, LoadedBoundary, Noise
from calibrate.data.outline import Outline
from calibrate.data.points import Kept
from calibrate.data.triangulation import boundary_nodes, signed_areas
from calibrate.effects.support.effect_data import free_edges
from calibrate.equations.noise_covariance import factor_of_points, noise_factor
from calibrate.errors import ConfigError, MeshMismatchError
from forward.loading import Loading
from forward.materials import MooneyRivlin
from forward.sheet.plane_stress import solve
from meshes import quads, triangles
from meshes.measured.unseen_rims import distance_beyond
from meshes.shapes import Ellipse, Rim, Segment
from meshes.specimens import PlateWithHole
from studies.replay.model_law import material_law
from studies.replay.replayed_experiment import BoundaryValues, Seen, replay
from studies.synthetic import camera

PLATE, PITCH, LAW = PlateWithHole(), 2.0, MooneyRivlin(0.25, 0.05)
(HOLE,) = PLATE.holes()


@cache
def solution():
    return solve(quads(PLATE, quarter=True, size_factor=0.5), LAW, Loading.clamped(PLATE.loaded, 20.0), 2).mirrored()


@cache
def kept() -> Kept:
    """The plate by a camera with a grid of points, none nearer than 0.8 mm to the hole."""
    x, y = np.arange(-60, 60.1, PITCH), np.arange(-30, 30.1, PITCH)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    points = points[distance_beyond(HOLE, points) > 0.8]
    cells = Delaunay(points).simplices.astype(np.int64)
    areas = signed_areas(points, cells)
    cells[areas < 0] = cells[areas < 0][:, ::-1]
    sides = np.linalg.norm(points[cells] - np.roll(points[cells], 1, axis=1), axis=2).max(axis=1)
    cells = cells[(sides < 2.2 * PITCH) & (np.abs(areas) > 1e-9)]
    found, loaded = solution(), []
    for name, at in (("left", -60.0), ("right", 60.0)):
        loaded.append(LoadedBoundary(name, np.flatnonzero(points[:, 0] == at), found.reactions[name]))
    free = np.setdiff1d(boundary_nodes(cells), np.concatenate([b.nodes for b in loaded]))
    none = np.zeros(0, np.int64)
    return Kept(np.arange(len(points)), none, points, cells, found.evaluate(points), tuple(loaded), free)


def seen(*given: Rim, fit: bool = False) -> Experiment:
    return as_test(with_continued_rims(kept(), given, fit))


def as_test(rims: WithRims) -> Experiment:
    k, told = rims.kept, {"rims": [found.to_dict() for found in rims.rims]}
    return Experiment("plate", k.points, k.triangles, k.displacements, k.loaded, k.free_nodes, 1.0, provenance=told, continued=rims.continued)  # fmt: skip


def test_the_true_law_meets_a_test_with_the_rim_that_was_given_and_none_without():
    """A staircase is a hole too large. The largest circle in it is one too large by its margin, which a strip makes up for."""
    law = material_law(LAW, "", seen())
    bare, given, fitted = seen(), seen(HOLE), seen(fit=True)
    errors = [replay(test, law, check_mesh=False) for test in (bare, given, fitted)]
    assert errors[0].force_error > 0.02
    assert errors[1].force_error < 1e-3
    assert errors[1].field_error[-1] < 0.03 * errors[0].field_error[-1]
    (hole,) = fitted.provenance["rims"]
    margin = hole["diameters"][0] / 2 - 10
    assert 0.8 <= margin < 0.8 + 0.35 * PITCH
    with_strip = replay(fitted, replace(law, strip=margin), check_mesh=False)
    assert with_strip.field_error[-1] < 0.1 * errors[0].field_error[-1]


def test_a_strip_is_beside_rims_that_were_fitted_and_not_beside_those_that_were_given():
    given, fitted = seen(HOLE), seen(fit=True)
    length = [free_edges(test)[0].sum() for test in (given, fitted)]
    assert length[0] == pytest.approx(240.0)
    assert length[1] == pytest.approx(240.0 + np.pi * fitted.provenance["rims"][0]["diameters"][0], rel=1e-2)
    grown = Seen.of(given, 0.5)
    assert signed_areas(grown.points, grown.triangles).sum() == pytest.approx(120 * 61 - HOLE.area, rel=1e-3)
    assert Outline.of(given).given.sum() == len(given.points) - given.n_measured == len(given.given_rims)
    assert not Outline.of(fitted).given.any()


def test_continued_points_are_no_measurement():
    """Their noise is that of those that they come from, a replay does not judge them, and a camera adds none of their own."""
    test, noise = seen(HOLE), Noise(0.01, 3.0)
    n = test.n_measured
    B = noise_factor(test, noise).toarray()
    measured = factor_of_points(test.points[:n], noise).toarray()
    np.testing.assert_allclose(B @ B.T, np.concatenate([np.eye(n), test.continued.toarray()]) @ measured @ measured.T @ np.concatenate([np.eye(n), test.continued.toarray()]).T, atol=1e-15)  # fmt: skip
    judged = BoundaryValues.of(test).judged
    assert judged.shape == (len(test.points),) and judged[:n].sum() == n - 62 and not judged[n:].any()
    noisy = camera.record(test, camera.Camera(), 3)
    np.testing.assert_allclose(
        noisy.displacements[:, n:], np.stack([test.continued @ u[:n] for u in noisy.displacements])
    )


def test_a_file_keeps_what_is_continued(tmp_path):
    test = seen(HOLE)
    test.save(tmp_path / "test.npz")
    again = Experiment.load(tmp_path / "test.npz")
    assert abs(again.continued - test.continued).max() == 0
    np.testing.assert_array_equal(again.given_rims, test.given_rims)
    with pytest.raises(MeshMismatchError, match="continued .* does not match"):
        replace(test, continued=test.continued[:-1])


def test_a_rim_that_the_camera_sees_is_left_alone_and_an_impossible_one_named():
    whole = kept()
    assert seen(fit=True).n_measured < len(seen(fit=True).points)
    one = camera.observe(solution(), triangles(PLATE, n_nodes=500), name="whole")
    rims = with_continued_rims(Kept(np.arange(len(one.points)), np.zeros(0, np.int64), one.points, one.triangles, one.displacements, one.loaded, one.free_nodes), (HOLE,), True)  # fmt: skip
    assert rims.continued is None and not rims.rims
    with pytest.raises(ConfigError, match=r"\[edges\] the hole at \(30, 0\) mm: no opening"):
        with_continued_rims(whole, (Ellipse(30.0, 0.0, 5.0, 5.0),), False)


def test_the_true_law_meets_a_sheet_whose_free_sides_are_not_seen():
    """Two rows of points less: the section is 4 mm wider than what is seen, and what is added is gripped where the grips are."""
    whole = kept()
    stays = np.abs(whole.points[:, 1]) < 29
    number = np.cumsum(stays) - 1
    cells = number[whole.triangles[stays[whole.triangles].all(axis=1)]]
    loaded = tuple(replace(b, nodes=number[b.nodes[stays[b.nodes]]]) for b in whole.loaded)
    free = np.setdiff1d(boundary_nodes(cells), np.concatenate([b.nodes for b in loaded]))
    cut = replace(whole, indices=np.arange(stays.sum()), points=whole.points[stays], triangles=cells, displacements=whole.displacements[:, stays], loaded=loaded, free_nodes=free)  # fmt: skip
    sides = Segment((-60.0, -30.0), (60.0, -30.0)), Segment((60.0, 30.0), (-60.0, 30.0))
    law = material_law(LAW, "", seen())
    tests = [as_test(with_continued_rims(cut, given, False)) for given in ((HOLE,), (HOLE, *sides))]
    errors = [replay(test, law, check_mesh=False) for test in tests]
    assert errors[0].force_error > 0.04 and errors[1].force_error < 1.5e-3
    assert errors[1].field_error[-1] < 0.05 * errors[0].field_error[-1]
    assert [len(b.nodes) for b in tests[1].loaded] == [len(b.nodes) + 2 for b in tests[0].loaded]
    assert signed_areas(tests[1].points, tests[1].triangles).sum() == pytest.approx(120 * 60 - HOLE.area, rel=1e-3)


@pytest.mark.parametrize("beyond", [0.25, 0.5, 0.7, 1.3])
def test_a_grip_reaches_to_a_side_however_near_the_last_points_are(beyond):
    """The last node of a grip gives way to the end of a side that is nearer than 0.3 distances of the points, as other points do: no corner is cut off."""
    y = 30.0 + beyond
    sides = Segment((-60.0, -y), (60.0, -y)), Segment((60.0, y), (-60.0, y))
    found = as_test(with_continued_rims(kept(), (HOLE, *sides), False))
    for b in found.loaded:
        places = found.points[b.nodes]
        assert [places[:, 1].min(), places[:, 1].max()] == pytest.approx([-y, y])
        assert np.ptp(places[:, 0]) == pytest.approx(0.0, abs=1e-9)
    assert signed_areas(found.points, found.triangles).sum() == pytest.approx(120 * 2 * y - HOLE.area, rel=1e-3)
    outline = Outline.of(found)
    assert outline.given[outline.free].all()
