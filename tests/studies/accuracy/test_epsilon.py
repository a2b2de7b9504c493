"""epsilon against closed forms, invariances, its distances and its area-weighted statistics."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from forward.errors import SolutionError
from forward.solution import SurfaceSolution
from meshes import Cross, quads
from meshes.specimens import Strip
from studies.accuracy import epsilon
from studies.accuracy.epsilon import (
    EpsilonField,
    difference,
    epsilon_field,
    grip_distance,
    rim_distance,
    weighted_quantile,
)

TIME = np.array([0.5, 1.0])


def homogeneous(mesh, *F):
    """The plane solution with deformation gradients F (n_inc, 2, 2) everywhere."""
    u = np.array([mesh.points @ (np.asarray(f) - np.eye(2)).T for f in F])
    force = {"right": np.zeros((len(F), 2)), "top": np.zeros((len(F), 2))}
    return SurfaceSolution(mesh, u, force, TIME, np.zeros(2), np.zeros(2, np.int64), 1.0)


@dataclass(frozen=True)
class Solid:
    """A surface with the same F (n_inc, 3, 3) everywhere."""

    plane: SurfaceSolution
    F: np.ndarray
    time: np.ndarray

    def surface_gauss(self):
        points, weights, _ = self.plane.gauss()
        return points, weights, np.broadcast_to(self.F[:, None], (len(self.F), len(points), 3, 3))


def solid(plane, *stretches):
    """Of a plane solution, with F = diag(stretches) in each increment."""
    return Solid(plane, np.array([np.diag(s) for s in stretches]), plane.time)


@pytest.fixture(scope="module")
def mesh():
    return quads(Cross(), quarter=True, size_factor=4)


@pytest.fixture(scope="module")
def plane(mesh):
    return homogeneous(mesh, np.diag([1.2, 0.95]), np.diag([1.5, 0.9]))


def test_is_zero_where_both_deform_alike(plane):
    field = epsilon_field(plane, solid(plane, (1.2, 0.95, 0.88), (1.5, 0.9, 0.7)))
    assert field.epsilon.shape == (2, len(field.points))
    np.testing.assert_allclose(field.epsilon, 0, atol=1e-12)
    assert field.statistics().maximum < 1e-12


def test_of_two_uniform_stretches_has_the_closed_form(plane, mesh):
    field = epsilon_field(plane, solid(plane, (1.2, 0.95, 1.0), (1.6, 0.8, 1.0)))
    a, b, c, d = 1.5**2, 0.9**2, 1.6**2, 0.8**2
    expected = np.hypot(a - c, b - d) / np.hypot(a, b)
    np.testing.assert_allclose(field.epsilon[1], expected, rtol=1e-12)
    found = field.statistics()
    np.testing.assert_allclose([found.maximum, found.mean, found.p95], expected, rtol=1e-12)
    assert found.area == pytest.approx(mesh.area(), rel=1e-12)


def test_sees_the_slope_of_the_surface_but_no_rotation_and_no_other_thickness_direction():
    F = np.eye(2)[None]
    tilted = np.eye(3)[None].copy()
    tilted[0, 2, 0] = 0.1
    np.testing.assert_allclose(difference(F, tilted), 0.01 / np.sqrt(2), rtol=1e-12)
    rng = np.random.default_rng(0)
    general = np.eye(3) + 0.3 * rng.standard_normal((5, 3, 3))
    rotation = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    F2 = np.eye(2) + 0.3 * rng.standard_normal((5, 2, 2))
    expected = difference(F2, general)
    np.testing.assert_allclose(difference(F2, rotation @ general), expected, rtol=1e-12)
    np.testing.assert_allclose(difference(F2, general[..., :2]), expected, rtol=1e-14)
    general[..., 2] = 0
    np.testing.assert_allclose(difference(F2, general), expected, rtol=1e-14)


def test_solutions_that_do_not_fit_are_named(plane):
    fitting = solid(plane, (1.2, 0.95, 1), (1.5, 0.9, 1))
    other = homogeneous(quads(Cross(), quarter=True, size_factor=2), np.eye(2), np.eye(2))
    with pytest.raises(SolutionError, match="another plane mesh"):
        epsilon_field(plane, replace(fitting, plane=other))
    with pytest.raises(SolutionError, match="same increments"):
        epsilon_field(plane, replace(fitting, time=TIME[:1]))


def test_distances_to_rims_and_grips():
    cross = Cross()
    points = np.array([[7.5, 0.0], [8.5, 0.0], [0.0, 5.75], [47.0, 30.0], [99.0, 0.0], [98.0, 39.5], [3.0, 95.0]])
    expected = [0.0, 1.0, 2.0]
    np.testing.assert_allclose(rim_distance(points)[:3], expected, atol=2e-3)
    brute = min(np.linalg.norm(hole.rim(20000) - points[3], axis=1).min() for hole in cross.holes())
    assert rim_distance(points)[3] == pytest.approx(brute, abs=2e-3)
    np.testing.assert_allclose(grip_distance(points)[[4, 5, 6]], [1, 2, 5], atol=1e-12)
    corner = np.hypot(100 - 60, 60 - 40)  # nearest to (60, 60) is the end of a grip
    assert grip_distance(np.array([[60.0, 60.0]]))[0] == pytest.approx(corner)
    strip = Strip()
    assert np.isinf(rim_distance(points, strip)).all()
    assert grip_distance(np.zeros((1, 2)), strip)[0] == pytest.approx(strip.half_extent[0])


def test_parts_of_the_surface_are_told_apart(plane, mesh):
    field = epsilon_field(plane, solid(plane, (1.2, 0.95, 1), (1.5, 0.9, 1)))
    marked = replace(field, epsilon=np.stack([field.rim_distance, field.grip_distance]))
    assert marked.statistics(marked.near_holes(2.0), 0).maximum <= 2
    zone = marked.away_from_grips(20.0)
    assert zone.any() and not zone.all()
    assert marked.epsilon[1][zone].min() > 20
    part, rest = marked.statistics(zone), marked.statistics(~zone)
    assert part.area + rest.area == pytest.approx(mesh.area())
    together = (part.mean * part.area + rest.mean * rest.area) / (part.area + rest.area)
    assert marked.statistics().mean == pytest.approx(together)
    nothing = marked.statistics(np.zeros(len(zone), bool))
    assert nothing.area == 0 and np.isnan(nothing.p95)


def quantile_by_definition(values, weights, share):
    return min(v for v in values if weights[values <= v].sum() >= share * weights.sum() * (1 - 1e-12))


@pytest.mark.parametrize("seed", range(5))
def test_weighted_quantile_follows_its_definition(seed):
    rng = np.random.default_rng(seed)
    values, weights = rng.integers(0, 12, 40) / 3.0, rng.random(40)
    shares = np.array([0.0, 0.05, 0.5, 0.95, 1.0])
    expected = [quantile_by_definition(values, weights, share) for share in shares]
    np.testing.assert_array_equal(weighted_quantile(values, weights, shares), expected)
    assert weighted_quantile(values, weights, 0.5) == expected[2]


def test_weights_count_like_repetitions():
    rng = np.random.default_rng(1)
    values, counts = rng.random(30), rng.integers(1, 9, 30)
    repeated = np.repeat(values, counts)
    for share in (0.1, 0.5, 0.95):
        expected = np.quantile(repeated, share, method="inverted_cdf")
        assert weighted_quantile(values, counts.astype(float), share) == expected


def test_file_round_trip(plane, tmp_path):
    field = epsilon_field(plane, solid(plane, (1.2, 0.95, 1), (1.6, 0.9, 1)))
    field.save(tmp_path / "epsilon_10.npz")
    again = EpsilonField.load(tmp_path / "epsilon_10.npz")
    for name in EpsilonField.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(again, name), getattr(field, name))
    assert len(again.points) == 9 * len(again.cells)
    np.testing.assert_array_equal(epsilon.epsilon(plane, solid(plane, (1.2, 0.95, 1), (1.6, 0.9, 1))), again.epsilon)
