"""The synthetic camera: its noise has the stated law, and coarsening keeps what it should."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

import meshes
from calibrate.data.experiment import Noise
from calibrate.errors import ConfigError, MeshMismatchError
from studies.synthetic import camera, coarsening

LENGTH = 4.0
LAGS = (1.0, 2.0, 4.0, 6.0, 8.0, 12.0)


@dataclass(frozen=True)
class Polynomial:
    """A made-up solution on the cross: displacements are polynomials of the position, mm."""

    quadratic: float = 0.0
    n_increments: int = 3
    reactions: dict = field(default_factory=dict)
    thickness: float = 1.5
    description: dict = field(default_factory=dict)

    @property
    def time(self):
        return np.arange(1.0, self.n_increments + 1)

    def evaluate(self, points):
        x, y = points.T
        u = np.stack([0.1 * x + 0.02 * y, 0.05 * x - 0.08 * y], axis=1)
        u = u + self.quadratic * np.stack([x * y - x**2, y**2 + 0.5 * x * y], axis=1)
        return self.time[:, None, None] / self.n_increments * u


def solution(quadratic=0.0, n_increments=3):
    force = np.linspace(1, 10, n_increments)[:, None] * np.array([1.0, 0.1])
    reactions = {"left": -force, "right": force, "bottom": -force[:, ::-1], "top": force[:, ::-1]}
    return Polynomial(quadratic, n_increments, reactions)


@cache
def mesh(size_factor=1.5):
    return meshes.triangles(meshes.Cross(), size_factor=size_factor)


def circle(n=200):
    """Points on a line of 200 mm, for the extent, and some between."""
    return np.stack([np.linspace(-100, 100, n), np.linspace(-100, 100, n) ** 3 / 1e4], axis=1)


# --- the random field -----------------------------------------------------------------------------------------


def test_spectrum_gives_the_stated_covariance_and_forgets_opposite_sides():
    """Exact covariance of the synthesised field: sum of amplitude^2 cos(k r)."""
    _, side = camera.GaussianField(LENGTH).grid(circle())
    waves, amplitude = camera._spectrum(LENGTH, side)

    def covariance(x, y):
        phase = 2 * np.pi / side * (waves[:, None] * x + waves[None] * y)
        return float((amplitude**2 * np.cos(phase)).sum())

    for r in (0.0, *LAGS, 20.0):
        expected = np.exp(-(r**2) / (2 * LENGTH**2))
        assert covariance(r, 0.0) == pytest.approx(expected, abs=1e-7)
        assert covariance(r * np.cos(0.6), r * np.sin(0.6)) == pytest.approx(expected, abs=1e-7)
    assert abs(covariance(200.0, 0.0)) < 1e-6


def test_empirical_covariance_of_the_nodal_noise():
    """Variance, decay, isotropy and independence of components from samples at points, interpolation included."""
    rng = np.random.default_rng(1)
    directions = np.array([[1.0, 0.0], [0.0, 1.0], [np.sqrt(0.5), np.sqrt(0.5)]])
    base = rng.uniform(-85, 85, (400, 2))
    shifted = base + (np.array(LAGS)[:, None, None, None] * directions[:, None])
    points = np.concatenate([[[-100, -100], [100, 100]], base, shifted.reshape(-1, 2)])
    field = camera.GaussianField(LENGTH)
    samples = np.array([field.sample(points, camera.stream(7, k))[2:] for k in range(40)])
    start, moved = samples[:, :400], samples[:, 400:].reshape(40, len(LAGS), 3, 400, 2)
    assert np.mean(samples) == pytest.approx(0, abs=0.03)
    assert np.mean(samples**2) == pytest.approx(1, abs=0.03)
    found = np.einsum("snc,sldnc->ld", start, moved) / (40 * 400 * 2)
    expected = np.exp(-(np.array(LAGS) ** 2) / (2 * LENGTH**2))
    assert found == pytest.approx(np.tile(expected[:, None], 3), abs=0.04)
    assert np.mean(samples[..., 0] * samples[..., 1]) == pytest.approx(0, abs=0.03)
    assert np.mean(samples[:-1] * samples[1:]) == pytest.approx(0, abs=0.03)
    assert stats.kurtosis(samples.ravel()) == pytest.approx(0, abs=0.1)


def test_what_increments_have_in_common():
    """The covariance between increments of the recorded displacements is the stated one; each field has its own random numbers."""
    device = camera.Camera(camera.GaussianField(LENGTH, 512), 1e-4, pattern_noise=4e-4, reference_noise=2e-4)
    shares, points = np.array([0.2, 0.6, 1.0]), np.random.default_rng(0).uniform(-90, 90, (500, 2))
    seen = [device.displacement_noise(points, 3, s) + device.common_noise(points, shares, s) for s in range(20)]
    found = np.einsum("sank,sbnk->ab", seen, seen) / np.size(seen) * 3
    stated = device.noise()
    common = stated.common_between(shares)
    expected = stated.displacement_std**2 * (np.eye(3) + common @ common.T)
    deviation = np.sqrt(np.diag(expected))
    assert (stated.pattern_std, stated.reference_std) == pytest.approx((0.08, 0.04))
    np.testing.assert_allclose(
        found / np.outer(deviation, deviation), expected / np.outer(deviation, deviation), atol=0.06
    )


def test_grid_has_2048_points_a_side_and_encloses_the_specimen():
    field = camera.GaussianField()
    origin, side = field.grid(mesh().points)
    assert field.on_grid(side, np.random.default_rng(0)).shape == (2048, 2048)
    assert (origin < mesh().points.min(axis=0)).all()
    assert (origin + side > mesh().points.max(axis=0)).all()
    assert side / 2048 < 0.03 * LENGTH


def test_interpolation_is_exact_for_bilinear_fields_and_periodic():
    i, j = np.meshgrid(np.arange(16.0), np.arange(16.0), indexing="ij")
    position = np.random.default_rng(0).uniform(0, 15, (50, 2))
    x, y = position.T
    found = camera.interpolate(2 + 3 * i - j + 0.5 * i * j, position)
    assert found == pytest.approx(2 + 3 * x - y + 0.5 * x * y)
    wave = np.cos(2 * np.pi * i / 16)
    assert camera.interpolate(wave, position + [16.0, -32.0]) == pytest.approx(camera.interpolate(wave, position))


def test_unit_maximum_is_the_other_reading():
    field = camera.GaussianField(normalisation="unit-maximum", resolution=512)
    values = field.on_grid(224.0, np.random.default_rng(0))
    assert np.abs(values.real).max() == pytest.approx(1)
    assert np.abs(values.imag).max() == pytest.approx(1)
    device = camera.Camera(field)
    seen = camera.observe(solution(), mesh(), device, seed=0)
    assert 0.15 < seen.noise.displacement_std / device.amplitude < 0.35


def test_field_options_are_checked():
    with pytest.raises(ConfigError, match="unit-variance"):
        camera.GaussianField(normalisation="unit")
    with pytest.raises(ConfigError, match="positive length"):
        camera.GaussianField(0.0)
    with pytest.raises(ConfigError, match="needs more than"):
        camera.GaussianField(0.5, 256).sample(circle(), np.random.default_rng(0))
    with pytest.raises(ConfigError, match="relative_noise"):
        camera.Camera(relative_noise=-1.0)


# --- camera and load cell -------------------------------------------------------------------------------------


def test_clean_experiment_is_the_solution():
    seen = camera.observe(solution(), mesh(), seed=None)
    assert seen.noise is None
    assert np.array_equal(seen.displacements, solution().evaluate(mesh().points))
    assert seen.thickness == 1.5
    assert [b.name for b in seen.loaded] == ["left", "right", "bottom", "top"]
    x, y = mesh().points.T
    ends = np.isclose(np.maximum(np.abs(x), np.abs(y)), 100)
    held = np.concatenate([b.nodes for b in seen.loaded])
    assert np.array_equal(np.sort(held), np.flatnonzero(ends))
    assert not np.isin(seen.free_nodes, held).any()


def test_noise_reaches_every_node_with_the_stated_strength():
    device = camera.Camera()
    clean, seen = camera.observe(solution(), mesh()), camera.observe(solution(), mesh(), device, seed=3)
    noise = seen.displacements - clean.displacements
    assert device.amplitude == pytest.approx(0.1)
    assert noise.std() == pytest.approx(0.1, rel=0.1)
    held = np.concatenate([b.nodes for b in seen.loaded])
    for nodes in (held, seen.free_nodes):
        assert noise[:, nodes].std() == pytest.approx(0.1, rel=0.3)
    assert seen.noise == Noise(device.amplitude, 4.0, 1e-4 / np.sqrt(3))
    assert seen.provenance["noise_seed"] == 3
    assert seen.provenance["camera"]["field"]["normalisation"] == "unit-variance"


def test_forces_are_uniform_and_equal_on_opposite_sides():
    factors = camera.Camera().force_factors(["left", "right", "bottom", "top"], 2000, 5)
    assert np.array_equal(factors["left"], factors["right"])
    assert np.array_equal(factors["bottom"], factors["top"])
    for name in ("left", "top"):
        draws = (factors[name] - 1) / 1e-4
        assert stats.kstest(draws, stats.uniform(-1, 2).cdf).pvalue > 0.01
        assert draws.std() == pytest.approx(1 / np.sqrt(3), rel=0.05)
    assert abs(np.corrcoef(factors["left"], factors["top"])[0, 1]) < 0.06


def test_recorded_forces_keep_opposite_sides_in_balance():
    seen = camera.observe(solution(), mesh(), seed=2)
    force = {b.name: b.force for b in seen.loaded}
    assert force["left"] == pytest.approx(-force["right"], rel=1e-14)
    ratio = force["right"] / solution().reactions["right"]
    assert (np.abs(ratio - 1) <= 1e-4).all()
    assert ratio[:, 0] == pytest.approx(ratio[:, 1], rel=1e-14)


def test_noise_depends_on_seed_and_increment_alone():
    device, points = camera.Camera(camera.GaussianField(resolution=512)), mesh().points
    long = device.displacement_noise(points, 4, 11)
    np.random.default_rng(0).standard_normal(10)
    assert np.array_equal(device.displacement_noise(points, 2, 11), long[:2])
    assert not np.allclose(device.displacement_noise(points, 2, 12), long[:2])
    names = ["left", "right", "bottom", "top"]
    forward, backward = device.force_factors(names, 3, 1), device.force_factors(names[::-1], 5, 1)
    assert all(np.array_equal(forward[name], backward[name][:3]) for name in names)


def test_observe_refuses_meshes_that_do_not_belong():
    with pytest.raises(MeshMismatchError, match="triangles"):
        camera.observe(solution(), meshes.quads(meshes.PlateWithHole()))
    with pytest.raises(MeshMismatchError, match="no boundary 'middle'"):
        camera.observe(replace(solution(), reactions={"middle": np.ones((3, 2))}), mesh())


# --- coarsening -----------------------------------------------------------------------------------------------


@cache
def projection(share):
    fine = mesh(1.0)
    coarse = meshes.triangles(meshes.Cross(), n_nodes=round(share * len(fine.points)))
    return coarsening.coarsening(fine.points, fine.cells, coarse)


def test_the_same_mesh_changes_nothing():
    fine = camera.observe(solution(1e-4), mesh(), seed=0)
    same = coarsening.coarsening(fine.points, fine.triangles, mesh()).apply(fine)
    assert np.array_equal(same.displacements, fine.displacements)
    assert same.noise == fine.noise


@pytest.mark.parametrize("share", [0.5, 0.25, 0.125])
def test_projection_keeps_linear_fields_and_boundaries(share):
    fine = camera.observe(solution(), mesh(1.0))
    coarse = projection(share).apply(fine)
    assert len(coarse.points) == pytest.approx(share * len(fine.points), rel=0.05)
    assert coarse.displacements == pytest.approx(solution().evaluate(coarse.points), abs=1e-7)
    for b in coarse.loaded:
        assert np.allclose(np.abs(coarse.points[b.nodes]).max(axis=1), 100)
        assert np.array_equal(b.force, solution().reactions[b.name])
    assert coarse.noise is None
    assert set(coarse.free_nodes) | {n for b in coarse.loaded for n in b.nodes} == set(
        np.unique(np.concatenate(list(projection(share).mesh.boundaries.values())))
    )


def test_projection_of_smooth_fields_converges_quadratically():
    square = meshes.SquareSheet()
    fine = meshes.triangles(square, size_factor=0.4)
    errors, sizes = [], (4.0, 2.0, 1.0)
    for size in sizes:
        coarse = meshes.triangles(square, size_factor=size)
        found = coarsening.coarsening(fine.points, fine.cells, coarse).field(solution(1e-3).evaluate(fine.points))
        errors.append(np.sqrt(np.mean((found - solution(1e-3).evaluate(coarse.points)) ** 2)))
    rate = np.log(errors[0] / errors[-1]) / np.log(sizes[0] / sizes[-1])
    assert rate > 1.7, errors


def test_interpolation_extrapolates_the_nearest_triangle():
    points, where = (
        mesh().points,
        np.array([[0.0, 0.0], [30.0, 30.0], [120.0, 5.0], [0.0, -130.0], [60.0, 60.0]]),
    )
    weights = coarsening.interpolation(points, mesh().cells, where)
    assert weights @ points == pytest.approx(where, abs=1e-9)
    assert abs(weights[:2]).max() < 3


def test_a_coarse_node_without_data_gets_a_value():
    coarse = meshes.triangles(meshes.SquareSheet(), size_factor=3.0)
    fine = meshes.triangles(meshes.SquareSheet(), size_factor=0.7)
    backward = coarsening.coarsening(coarse.points, coarse.cells, fine)
    u = solution().evaluate(coarse.points)
    assert backward.field(u) == pytest.approx(solution().evaluate(fine.points), abs=0.3)


@pytest.mark.parametrize("share", [0.5, 0.125])
def test_stated_noise_of_projected_data_is_what_comes_out(share):
    """The noise stated for the coarse data against independent samples from the camera's own field."""
    project = projection(share)
    stated = project.noise(Noise(0.1, LENGTH, 1e-4))
    device = camera.Camera()
    samples = device.displacement_noise(project.fine_points, 30, 4)
    coarse = project.field(samples)
    assert coarse.std() == pytest.approx(stated.displacement_std, rel=0.03)
    assert stated.force_std_relative == 1e-4
    flat = np.moveaxis(coarse, 1, 0).reshape(len(project.mesh.points), -1)
    length = coarsening.covariance_fit(project.mesh.points, flat, LENGTH)[1]
    assert length == pytest.approx(stated.correlation_length, rel=0.05)
    free = project.mesh.boundary_nodes("free")
    assert coarse[:, free].std() > 0.9 * stated.displacement_std


def test_noise_of_forces_alone_is_not_projected():
    noise = Noise(0.0, force_std_relative=1e-3, force_std=0.1)
    assert projection(0.5).noise(noise) == noise


def test_covariance_fit_recovers_what_was_put_in():
    points = np.random.default_rng(0).uniform(-60, 60, (1500, 2))
    device = camera.Camera(camera.GaussianField(6.0, 512), relative_noise=1e-3)
    samples = device.displacement_noise(points, 20, 0)
    flat = np.moveaxis(samples, 1, 0).reshape(len(points), -1)
    std, length = coarsening.covariance_fit(points, flat, 4.0)
    assert std == pytest.approx(0.2, rel=0.03)
    assert length == pytest.approx(6.0, rel=0.05)
    white = np.random.default_rng(1).standard_normal((1500, 40))
    assert coarsening.covariance_fit(points, white, 0.0)[1] == 0.0


def test_coarsening_refuses_another_mesh():
    with pytest.raises(MeshMismatchError, match="not on the fine mesh"):
        projection(0.5).apply(camera.observe(solution(), mesh()))
