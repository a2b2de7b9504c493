"""Whole runs of the solid against closed forms, symmetry, work, the thin sheet and its own limit in kappa."""

from pathlib import Path

import numpy as np
import pytest
from forward_helpers import MATERIALS, energy_derivatives, nominal_stresses
from scipy.optimize import root
from solid_helpers import block, grid, pressure_jumps

from forward import ArrudaBoyce, Loading, NeoHooke, SolidSolution
from forward.errors import SolutionError
from forward.sheet import plane_stress as sheet
from forward.solid.solid_model import Options, solve
from meshes import Cross, PlateWithHole, Strip, extrude, quads

SHARP = Options(tolerance=1e-10, volume_tolerance=1e-12)
MODES = {"uniaxial": (2.0, None), "biaxial": (1.5, 1.5), "unequal": (1.8, 0.9), "pure_shear": (1.7, 1.0)}


def principal_stresses(material, kappa, stretches):
    """Nominal stresses (3,) of the perturbed Lagrangian where the pressure is kappa (J - 1), MPa."""
    a = np.asarray(stretches)
    J, I1, I2 = a.prod(), (a**2).sum(), ((a**2).sum() ** 2 - (a**4).sum()) / 2
    psi1, psi2 = energy_derivatives(material, J ** (-2 / 3) * I1)
    P = 2 * psi1 * J ** (-2 / 3) * (a - I1 / (3 * a))
    P += 2 * psi2 * J ** (-4 / 3) * (I1 * a - a**3 - 2 / 3 * I2 / a)
    return P + kappa * (J - 1) * J / a


def homogeneous(material, kappa, first, second):
    """Stretches (3,) and nominal stresses (3,) at given in-plane stretches, the rest (None) free of stress."""
    free = np.array([False, second is None, True])
    stretches = np.array([first, second or first**-0.5, 0.0])
    stretches[2] = 1 / stretches[:2].prod()

    def stresses_left(x):
        stretches[free] = x
        return principal_stresses(material, kappa, stretches)[free] / kappa

    stretches[free] = root(stresses_left, stretches[free], tol=1e-15).x
    return stretches, principal_stresses(material, kappa, stretches)


def pulled(mesh, material, first, second, kappa):
    """A block of 2 x 1.5 x 2 mm, its right side moved, its upper side too unless `second` is None."""
    loading = {"right": (2.0 * (first - 1), None, None)}
    if second is not None:
        loading["top"] = (None, 1.5 * (second - 1), None)
    return solve(mesh, material, Loading(loading), 3, bulk_modulus=kappa, options=SHARP)


CASES = [("mooney_rivlin", mode) for mode in MODES] + [(name, "biaxial") for name in MATERIALS if "mooney" not in name]


@pytest.mark.parametrize(("name", "mode"), CASES)
def test_homogeneous_states(name, mode):
    """Forces, displacements and pressure on a distorted block, with the compressibility taken into account."""
    mesh, material = block(n=(2, 1), layers=1), MATERIALS[name]
    kappa = 1e4 * material.shear_modulus
    solution = pulled(mesh, material, *MODES[mode], kappa)
    stretches, P = homogeneous(material, kappa, *MODES[mode])
    np.testing.assert_allclose(P[2], 0, atol=1e-10)
    assert solution.reactions["right"][-1, 0] == pytest.approx(3.0 * P[0], rel=1e-8)
    if "top" in solution.reactions:
        assert solution.reactions["top"][-1, 1] == pytest.approx(4.0 * P[1], rel=1e-8)
    np.testing.assert_allclose(solution.displacements[-1], mesh.points * (stretches - 1), atol=1e-8)
    np.testing.assert_allclose(solution.pressure[-1, :, 0], kappa * (stretches.prod() - 1), rtol=1e-7)


def test_incompressible_limit():
    """At twice the length neo-Hooke's force is 17/18 mu / kappa below the incompressible one, Arruda-Boyce's 1.02.

    For neo-Hooke P = mu J^(-2/3) (a - J / a^2) with p = mu (a^2 - 1 / a) / 3 = kappa (J - 1), to first order.
    """
    for material, slope in ((NeoHooke(0.3), -17 / 18), (ArrudaBoyce(), -1.02)):
        limit, ratio = nominal_stresses(material, 2.0, 2**-0.5)[0], 1e4
        stretches, P = homogeneous(material, ratio * material.mu, 2.0, None)
        assert stretches[1] == pytest.approx(stretches[2], rel=1e-12)
        assert (P[0] / limit - 1) * ratio == pytest.approx(slope, rel=2e-3)
    for ratio in (1e3, 1e5):
        solution = pulled(block((1, 1), 1), NeoHooke(0.3), 2.0, None, ratio * 0.3)
        force = nominal_stresses(NeoHooke(0.3), 2.0, 2**-0.5)[0] * 3.0
        assert (solution.reactions["right"][-1, 0] / force - 1) * ratio == pytest.approx(-17 / 18, rel=4e-3)


PLATE = PlateWithHole()


@pytest.fixture(scope="module")
def coarse():
    """A quarter of the plate in 28 quads."""
    return quads(PLATE, quarter=True, size_factor=4.0)


@pytest.fixture(scope="module")
def eighth(coarse):
    """An eighth of the plate, its grips moved out by 20 mm each."""
    loading = Loading.clamped(PLATE.loaded, 20.0, dimension=3, hold_thickness=True)
    return solve(extrude(coarse, 10.0, 1), ArrudaBoyce(), loading, 2, options=SHARP)


def check_whole(part, plane, loading, material):
    """The whole specimen, meshed alike, does what its eighth says."""
    mesh = extrude(plane, part.thickness, part.mesh.layers, whole=True)
    whole = solve(mesh, material, loading, len(part.time), options=SHARP)
    mirrored, surface = part.surface().mirrored(), whole.surface()
    np.testing.assert_allclose(surface.points, mirrored.points)
    np.testing.assert_allclose(surface.displacements, mirrored.displacements, atol=1e-9)
    n = len(plane.points)
    np.testing.assert_allclose(whole.displacements[:, :n] * [1, 1, -1], whole.displacements[:, -n:], atol=1e-9)
    scale = np.abs(part.reactions["right"]).max()
    for side, force in whole.reactions.items():
        np.testing.assert_allclose(force[:, :2], mirrored.reactions[side], atol=1e-9 * scale)
        np.testing.assert_allclose(force[:, 2], 0, atol=1e-9 * scale)
    for force in part.reactions.values():
        np.testing.assert_array_equal(force[:, 2], 0)
    np.testing.assert_allclose(whole.energy, 8 * part.energy, rtol=1e-9)
    np.testing.assert_allclose(surface.energy, mirrored.energy, rtol=1e-9)


def test_eighth_and_whole_plate(eighth):
    loading = Loading.clamped(PLATE.loaded, 20.0, dimension=3, hold_thickness=True)
    check_whole(eighth, eighth.mesh.plane.mirrored()[0], loading, ArrudaBoyce())


@pytest.mark.slow
def test_eighth_and_whole_cross():
    plane, loading = quads(Cross(), True, 4.0), Loading.clamped(Cross.loaded, 10.0, 3, hold_thickness=True)
    part = solve(extrude(plane, 10.0, 1), ArrudaBoyce(), loading, 1, options=SHARP)
    check_whole(part, plane.mirrored()[0], loading, ArrudaBoyce())


def test_grips_hold_the_thickness_or_not(eighth, coarse):
    """Held, the side keeps its thickness; free, as in plane stress, it thins as the rest does and pulls less."""
    loading = Loading.clamped(PLATE.loaded, 20.0, dimension=3)
    free = solve(extrude(coarse, 10.0, 1), ArrudaBoyce(), loading, 2, options=SHARP)
    side = eighth.mesh.boundary_nodes("right")
    np.testing.assert_allclose(eighth.displacements[-1, side], np.tile([20.0, 0, 0], (len(side), 1)), atol=1e-12)
    np.testing.assert_allclose(free.displacements[-1, side, :2], np.tile([20.0, 0], (len(side), 1)), atol=1e-12)
    assert free.displacements[-1, side, 2].min() < -0.3
    assert free.reactions["right"][-1, 0] < eighth.reactions["right"][-1, 0]


def test_the_work_of_the_grips_is_stored(coarse):
    """Simpson's rule over n increments misses it by n^-4: nothing is made or lost between grips and energy."""
    mesh, errors = extrude(coarse, 10.0, 1), []
    for n in (4, 8, 16):
        loading = Loading.clamped(PLATE.loaded, 30.0, dimension=3)
        solution = solve(mesh, ArrudaBoyce(), loading, n, options=SHARP)
        force = np.concatenate([[0], solution.reactions["right"][:, 0]])
        weights = np.tile([2.0, 4.0], n // 2 + 1)[: n + 1]
        weights[[0, -1]] = 1
        work = 30.0 / (3 * n) * weights @ force / 2  # forces are of the whole thickness, the energy of its half
        errors.append(abs(work / solution.energy[-1] - 1))
    assert errors[-1] < 1e-6
    assert np.log2(np.divide(errors[:-1], errors[1:])).min() > 3.5


def difference_from_sheet(size_factor, thickness, layers=1):
    """|C_2D - C_3D| / |C_2D| at surface points away from rim and grips, maximum; relative difference of the forces."""
    plane, material = quads(PLATE, True, size_factor), ArrudaBoyce()
    thin = sheet.solve(plane, material, Loading.clamped(PLATE.loaded, 20.0), 3)
    loading = Loading.clamped(PLATE.loaded, 20.0, dimension=3)
    solution = solve(extrude(plane, thickness, layers), material, loading, 3, 1e6 * material.mu)
    points, _, F = solution.surface_gauss()
    C_3D = np.einsum("kia,kib->kab", F[-1], F[-1])[:, :2, :2]
    C_2D = np.einsum("kia,kib->kab", thin.gauss()[2][-1], thin.gauss()[2][-1])
    epsilon = np.linalg.norm(C_2D - C_3D, axis=(1, 2)) / np.linalg.norm(C_2D, axis=(1, 2))
    x, y = points.T
    away = (np.hypot(x, y) > 22) & (x < 48) & (y < 27)
    assert away.sum() > 50
    force = solution.reactions["right"][-1, 0] / thickness / thin.reactions["right"][-1, 0] - 1
    return epsilon[away].max(), force


def test_thin_limit_is_the_sheet():
    """At 1 mm what is left, 12 mm from rim and grips, is the mesh: the two elements approach each other."""
    (coarse_epsilon, coarse_force), (epsilon, force) = difference_from_sheet(2.0, 1.0), difference_from_sheet(1.0, 1.0)
    assert epsilon < 2e-3
    assert abs(force) < 2e-4
    assert coarse_epsilon / epsilon > 3
    assert coarse_force / force > 2


@pytest.mark.slow
def test_thickness_acts_by_its_square():
    """On one mesh the force per thickness leaves its thin limit as h^2."""
    thin = difference_from_sheet(1.0, 0.25)[1]
    excess = [difference_from_sheet(1.0, h, layers=2)[1] - thin for h in (2.0, 4.0, 8.0)]
    np.testing.assert_allclose(np.log2(np.divide(excess[1:], excess[:-1])), 2, atol=0.25)


def test_no_locking_and_no_checkerboard(coarse):
    """On one coarse mesh force and pressure jumps go to a limit as 1 / kappa; a finer mesh has the same limit."""

    def limit(plane, layers, ratio):
        loading = Loading.clamped(PLATE.loaded, 20.0, dimension=3, hold_thickness=True)
        solution = solve(extrude(plane, 10.0, layers), ArrudaBoyce(), loading, 4, ratio * ArrudaBoyce().mu)
        jumps = pressure_jumps(solution.mesh, solution.pressure[-1])
        return solution.reactions["right"][-1, 0], np.sqrt((jumps**2).mean())

    forces, jumps = np.transpose([limit(coarse, 1, ratio) for ratio in (1e2, 1e3, 1e4, 1e5, 1e6)])
    np.testing.assert_allclose(np.diff(forces)[:-1] / np.diff(forces)[1:], 10, rtol=0.03)
    np.testing.assert_allclose(np.diff(jumps)[:-1] / np.diff(jumps)[1:], 10, rtol=0.1)
    assert np.ptp(forces) < 0.01 * forces[-1]
    finer_force, finer_jumps = limit(quads(PLATE, True, 1.0), 2, 1e6)
    assert finer_force == pytest.approx(forces[-1], rel=0.01)
    assert finer_force < forces[-1]
    assert finer_jumps < jumps[-1] / 2


def test_surface(eighth):
    """The in-plane gradients of the surface, and the places of its Gauss points, are those of its quads."""
    surface, (points, weights, F) = eighth.surface(), eighth.surface_gauss()
    plane_points, plane_weights, plane_F = surface.gauss()
    np.testing.assert_array_equal(points, plane_points)
    np.testing.assert_array_equal(weights, plane_weights)
    assert weights.sum() == pytest.approx(eighth.mesh.plane.area(), rel=1e-12)
    np.testing.assert_allclose(F[..., :2, :2], plane_F, atol=1e-12)
    assert surface.thickness == 10.0


def test_surface_gradient_of_a_known_displacement():
    """A triquadratic displacement is differentiated exactly, across the thickness too."""
    mesh = extrude(grid((2, 1), (2.0, 1.0)), 3.0, 2)
    x, y, z = mesh.points.T
    u = np.column_stack([x * z**2, y * z + x**2, x * y * z**2])[None]
    points, _, F = made_up(mesh, u, np.zeros((1, len(mesh.cells), 4))).surface_gauss()
    (x, y), z, one, zero = points.T, 1.5, np.ones(len(points)), np.zeros(len(points))
    gradient = [[z**2 * one, zero, 2 * x * z], [2 * x, z * one, y], [y * z**2, x * z**2, 2 * x * y * z]]
    np.testing.assert_allclose(F[0] - np.eye(3), np.moveaxis(np.array(gradient), -1, 0), atol=1e-12)


def made_up(mesh, u, q):
    one = np.ones(len(u))
    return SolidSolution(mesh, u, q, {"right": np.ones((len(u), 3))}, one, one, one.astype(int), 100.0, {"made": "up"})


def test_file(eighth, tmp_path):
    path = tmp_path / "new" / "solid.npz"
    eighth.save(path)
    copy = SolidSolution.load(path)
    for name in ("displacements", "pressure", "time", "energy", "iterations"):
        np.testing.assert_array_equal(getattr(copy, name), getattr(eighth, name))
    np.testing.assert_array_equal(copy.mesh.points, eighth.mesh.points)
    np.testing.assert_array_equal(copy.reactions["right"], eighth.reactions["right"])
    assert copy.mesh.boundaries.keys() == eighth.mesh.boundaries.keys()
    assert (copy.bulk_modulus, copy.description) == (eighth.bulk_modulus, eighth.description)
    eighth.surface().save(path)
    with pytest.raises(SolutionError, match="equigap-solid"):
        SolidSolution.load(path)


def test_the_example_of_the_documentation_runs(tmp_path, monkeypatch, capsys):
    """The Python block of docs/forward.md, as it stands."""
    text = (Path(__file__).parents[3] / "docs" / "forward.md").read_text()
    code = text.split("```python\n")[1].split("```")[0]
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(code, names)
    half, whole = (names[name].reactions["right"][-1][0] for name in ("solution", "camera"))
    assert whole == pytest.approx(2 * half)
    np.testing.assert_array_equal(names["again"].displacements, names["solution"].displacements)


def test_no_load_needs_no_solve():
    mesh = extrude(quads(Strip(far_size=20.0), quarter=True), 4.0, 1)
    solution = solve(mesh, NeoHooke(), Loading.clamped(["right"], 0.0, dimension=3), 2)
    assert solution.iterations.sum() == 0
    assert not solution.displacements.any()
