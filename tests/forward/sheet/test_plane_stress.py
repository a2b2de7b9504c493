"""The plane-stress model against closed forms, energy balance, symmetry and its own interpolation."""

import numpy as np
import pytest
from forward_helpers import MATERIALS, annulus, nominal_stresses
from scipy.interpolate import CubicSpline

from forward import ArrudaBoyce, Loading, NeoHooke, SurfaceSolution
from forward.errors import SolutionError
from forward.sheet.plane_stress import default_experiment, solve
from meshes import Cross, PureShearSheet, SquareSheet, Strip, quads

THICKNESS = 1.7


@pytest.fixture(scope="module")
def quarter_cross():
    mesh = quads(Cross(), quarter=True, size_factor=3.0)
    return solve(mesh, ArrudaBoyce(), Loading.clamped(Cross.loaded, 30.0), 4)


@pytest.mark.parametrize("material", MATERIALS.values(), ids=MATERIALS)
def test_uniaxial_strip_with_free_sides(material):
    strip = Strip(half_length=30.0, half_width=10.0, far_size=8.0)
    solution = solve(quads(strip, quarter=True), material, Loading({"right": (45.0, None)}), 3, THICKNESS)
    for u, force, t in zip(solution.displacements, solution.reactions["right"], solution.time, strict=True):
        a = 1 + 1.5 * t
        stress, transverse = nominal_stresses(material, a, a**-0.5)
        assert transverse == pytest.approx(0, abs=1e-14)
        assert force[0] == pytest.approx(stress * 10.0 * THICKNESS, rel=1e-8)
        expected = solution.points * [a - 1, a**-0.5 - 1]
        np.testing.assert_allclose(u, expected, atol=1e-8)


@pytest.mark.parametrize("material", MATERIALS.values(), ids=MATERIALS)
def test_pure_shear_sheet(material):
    sheet = PureShearSheet(half_length=30.0, half_width=10.0, far_size=8.0)
    loading = Loading({"right": (0.0, None), "top": (None, 12.0)})
    solution = solve(quads(sheet, quarter=True), material, loading, 3, THICKNESS)
    held, pulled = nominal_stresses(material, 1.0, 2.2)
    assert solution.reactions["top"][-1, 1] == pytest.approx(pulled * 30.0 * THICKNESS, rel=1e-8)
    assert solution.reactions["right"][-1, 0] == pytest.approx(held * 10.0 * THICKNESS, rel=1e-8)


@pytest.mark.parametrize("material", MATERIALS.values(), ids=MATERIALS)
def test_equibiaxial_sheet(material):
    sheet = SquareSheet(half_length=10.0, half_width=10.0, far_size=5.0)
    loading = Loading({"right": (8.0, None), "top": (None, 8.0)})
    full = solve(quads(sheet, quarter=True), material, loading, 3, THICKNESS).mirrored()
    stress, _ = nominal_stresses(material, 1.8, 1.8)
    for side, axis, sign in (("left", 0, -1), ("right", 0, 1), ("bottom", 1, -1), ("top", 1, 1)):
        assert full.reactions[side][-1, axis] == pytest.approx(sign * stress * 20.0 * THICKNESS, rel=1e-8)
    np.testing.assert_allclose(full.deformation_gradient([[3.0, -7.0]])[-1, 0], 1.8 * np.eye(2), atol=1e-8)


def test_stored_energy_is_external_work():
    """Work of the grips, integrated by a cubic spline through 24 increments, whose error is of fourth order."""
    mesh = quads(Cross(), quarter=True, size_factor=4.0)
    solution = solve(mesh, ArrudaBoyce(), Loading.clamped(Cross.loaded, 60.0), 24)
    force = solution.reactions["right"][:, 0] + solution.reactions["top"][:, 1]
    work = CubicSpline(np.r_[0, solution.time] * 60.0, np.r_[0, force]).antiderivative()
    np.testing.assert_allclose(solution.energy, work(solution.time * 60.0), rtol=1e-4)
    assert solution.energy[-1] == pytest.approx(work(60.0), rel=1e-6)


def test_quarter_is_full_model(quarter_cross):
    mesh = quads(Cross(), size_factor=3.0)
    full = solve(mesh, ArrudaBoyce(), Loading.clamped(Cross.loaded, 30.0), 4)
    mirrored = quarter_cross.mirrored()
    np.testing.assert_allclose(mirrored.points, mesh.points, atol=1e-12)
    np.testing.assert_allclose(mirrored.displacements, full.displacements, atol=1e-7)
    np.testing.assert_allclose(mirrored.energy, full.energy, rtol=1e-9)
    for side in Cross.loaded:
        np.testing.assert_allclose(mirrored.reactions[side], full.reactions[side], atol=1e-7)
    total = sum(full.reactions.values())
    np.testing.assert_allclose(total, 0, atol=1e-7)


def test_grips_pull(quarter_cross):
    """Forces of the grips on the specimen point outward and grow."""
    mirrored = quarter_cross.mirrored()
    assert (np.diff(mirrored.reactions["right"][:, 0], prepend=0) > 0).all()
    assert (np.diff(mirrored.reactions["bottom"][:, 1], prepend=0) < 0).all()


def test_evaluation(quarter_cross):
    full = quarter_cross.mirrored()
    np.testing.assert_allclose(full.evaluate(full.points), full.displacements, atol=1e-8)
    inside = np.random.default_rng(0).uniform(-12, 12, (50, 2))
    inside = inside[np.hypot(inside[:, 0] / 7.5, inside[:, 1] / 3.75) > 1.1]
    np.testing.assert_allclose(full.evaluate(-inside), -full.evaluate(inside), atol=1e-9)
    step = 1e-4
    for axis in range(2):
        e = step * np.eye(2)[axis]
        slope = (full.evaluate(inside + e) - full.evaluate(inside - e)) / (2 * step)
        F = full.deformation_gradient(inside)
        inner = np.isclose(np.eye(2)[axis] + slope, F[..., axis], atol=1e-5).all(axis=(0, 2))
        assert inner.mean() > 0.95  # the gradient jumps where the step crosses a cell boundary


def test_evaluation_beyond_the_rim():
    """A quadratic field is continued exactly into the sliver behind a chord; far points are refused."""
    mesh = annulus(4)
    field = mesh.points**2 + mesh.points[:, ::-1]
    zero = np.zeros(1)
    solution = SurfaceSolution(mesh, field[None], {}, zero, zero, zero.astype(int), 1.0)
    near = np.array([[0.9999 * np.cos(0.3), 0.9999 * np.sin(0.3)], [2.0001, 0.0001]])
    np.testing.assert_allclose(solution.evaluate(near)[0], near**2 + near[:, ::-1], atol=2e-3)
    with pytest.raises(SolutionError, match="outside"):
        solution.evaluate([[0.1, 0.1]])
    with pytest.raises(SolutionError, match="finite"):
        solution.evaluate([[np.nan, 0.1]])


def test_file(quarter_cross, tmp_path):
    path = tmp_path / "new" / "solution.npz"
    quarter_cross.save(path)
    copy = SurfaceSolution.load(path)
    np.testing.assert_array_equal(copy.displacements, quarter_cross.displacements)
    np.testing.assert_array_equal(copy.reactions["top"], quarter_cross.reactions["top"])
    assert copy.mirrored().mesh.boundaries.keys() == quarter_cross.mirrored().mesh.boundaries.keys()
    assert copy.description == quarter_cross.description
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(SolutionError, match="solution.npz"):
        SurfaceSolution.load(path)


def test_a_full_model_is_not_mirrored():
    sheet = SquareSheet(far_size=50.0)
    solution = solve(quads(sheet), NeoHooke(), Loading.clamped(sheet.loaded[:2], 1.0), 1)
    with pytest.raises(SolutionError, match="quarter"):
        solution.mirrored()


def test_default_experiment_in_small():
    solution = default_experiment(size_factor=4.0, n_increments=3)
    assert set(solution.reactions) == set(Cross.loaded)
    F = solution.deformation_gradient([[85.0, 0.0], [0.0, 85.0]])[-1]
    np.testing.assert_allclose([F[0, 0, 0], F[1, 1, 1]], 1.68, atol=0.05)
