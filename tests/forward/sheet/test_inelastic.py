"""Sheets beyond the elastic, homogeneous one: each addition against a closed form."""

import numpy as np
import pytest
from forward_helpers import MODEL, nominal_stresses
from scipy.integrate import quad
from scipy.optimize import brentq, fsolve
from scipy.special import erf
from viscous_states import LATERAL, nominal_stress

from forward import ArrudaBoyce, Loading, MooneyRivlin, NeoHooke, Pann, Yeoh
from forward._dolfinx import MPI
from forward.errors import ConvergenceError, LoadingError, MaterialError
from forward.loading import MeasuredMotion
from forward.sheet.additions import Fibres, Gradient, MooneyPart, Mullins, Patch, Payne
from forward.sheet.damage_and_dispersion import OgdenRoxburgh
from forward.sheet.inelastic import solve_history
from forward.sheet.inelastic_problem import InelasticProblem
from forward.sheet.plane_stress import Options, solve
from forward.sheet.thin_sheet import PermanentSet, Prony, Sheet
from meshes import Cross, SquareSheet, Strip, quads, triangles

L, W, H = 20.0, 10.0, 1.5  # half length and half width of the strip, thickness, mm
NEO = NeoHooke(0.4)
PULL = Loading({"right": (L, None)})  # of a quarter: stretch 1 + load factor


@pytest.fixture(scope="module")
def strip():
    return quads(Strip(half_length=L, half_width=W, far_size=10.0), quarter=True)


def force(solution):
    """On the whole strip, N."""
    return 2 * solution.reactions["right"][:, 0]


def uniaxial(material, a):
    """Nominal stress, MPa, and I1 - 3 of an incompressible strip."""
    return nominal_stresses(material, a, a**-0.5)[0], a**2 + 2 / a - 3


def affine(sheet, F, specimen=None):
    """The square sheet with every node moved by F: its problem after one step."""
    mesh = quads(specimen or SquareSheet(half_length=5.0, half_width=5.0, far_size=5.0))
    values = mesh.points @ (np.asarray(F) - np.eye(2)).T
    problem = InelasticProblem(mesh, sheet, np.ones_like(values, bool), values, 1e-10, 25, MPI.COMM_WORLD)
    assert problem.step(1.0, 1.0).converged
    return problem


def traction(problem, side="right"):
    """Mean nominal traction (2,) on a side, MPa."""
    nodes = problem.mesh.boundary_nodes(side)
    inner = problem.nodal_forces()[nodes].sum(axis=0)
    return inner / (np.ptp(problem.mesh.points[nodes], axis=0).max() * problem.sheet.thickness)


@pytest.mark.parametrize("material", [ArrudaBoyce(), Yeoh()], ids=["arruda_boyce", "yeoh"])
def test_a_plain_sheet_is_plane_stress(material):
    mesh = quads(Cross(), quarter=True, size_factor=4.0)
    loading = Loading.clamped(Cross.loaded, 40.0)
    expected = solve(mesh, material, loading, 4)
    found = solve_history(mesh, Sheet(material), loading, [0.5, 1.0, 0.75, 0.25], [1, 2, 3, 4])
    for i, k in enumerate([1, 3, 2, 0]):
        np.testing.assert_allclose(found.displacements[i], expected.displacements[k], atol=1e-7)
        np.testing.assert_allclose(found.reactions["top"][i], expected.reactions["top"][k], atol=1e-8)
    np.testing.assert_allclose(found.energy[[3, 0, 2, 1]], expected.energy, rtol=1e-9)
    np.testing.assert_array_equal(found.time, [1, 2, 3, 4])


def test_mooney_part_is_mooney_rivlin(strip):
    expected = solve(strip, MooneyRivlin(0.2, 0.05), PULL, 1, H)
    found = solve_history(strip, Sheet(NeoHooke(0.4), H, (MooneyPart(0.05),)), PULL, [1.0], [1.0])
    np.testing.assert_allclose(found.displacements, expected.displacements, atol=1e-9)
    np.testing.assert_allclose(found.reactions["right"], expected.reactions["right"], atol=1e-9)


def fibre_stress(k, angles, F, k2=0.0):
    """2 k E exp(k2 E^2) F M x M with E = I4 - 1, MPa, summed over the families."""
    total = np.zeros((2, 2))
    for angle in angles:
        M = np.array([np.cos(angle), np.sin(angle)])
        FM = F @ M
        E = FM @ FM - 1
        total += 2 * k * E * np.exp(k2 * E**2) * np.outer(FM, M)
    return total


@pytest.mark.parametrize("k2", [0.0, 0.7])
@pytest.mark.parametrize("angles", [(0.6,), (0.3, -1.1)], ids=["one family", "two families"])
def test_fibres_add_their_stress(angles, k2):
    F = np.array([[1.4, 0.25], [-0.1, 0.9]])
    base = affine(Sheet(NEO, H), F)
    reinforced = affine(Sheet(NEO, H, (Fibres(0.03, angles, k2),)), F)
    P = fibre_stress(0.03, angles, F, k2)
    for side, column in (("right", 0), ("top", 1)):
        np.testing.assert_allclose(traction(reinforced, side) - traction(base, side), P[:, column], atol=1e-12)


def test_fibres_on_both_sides_of_the_axis_keep_a_strip_straight(strip):
    """Uniaxial tension with fibres at +-0.5: transverse stretch from P22 = 0, by a root of the closed form."""
    fibres = Fibres(0.1, (0.5, -0.5))
    found = solve_history(strip, Sheet(NEO, H, (fibres,)), PULL, [0.2, 0.4], [1, 2])

    def stress(a, b):
        return np.add(nominal_stresses(NEO, a, b), np.diag(fibre_stress(0.1, (0.5, -0.5), np.diag([a, b]))))

    b = brentq(lambda b: stress(1.4, b)[1], 0.5, 1.0)
    assert force(found)[-1] == pytest.approx(stress(1.4, b)[0] * 2 * W * H, rel=1e-8)
    np.testing.assert_allclose(found.displacements[-1], found.points * [0.4, b - 1], atol=1e-7)


@pytest.mark.parametrize("beside", [(), (MooneyPart(0.04),)], ids=["I1", "I1 and I2"])
def test_compressible_strip(strip, beside):
    """Stretches across and in thickness from both transverse stresses = 0, derivatives by central differences."""
    kappa, a = 2.0, 1.6
    c01 = sum(part.c01 for part in beside)

    def energy(stretches):
        J = np.prod(stretches)
        s = np.asarray(stretches) * J ** (-1 / 3)
        return 0.2 * ((s**2).sum() - 3) + c01 * ((s**-2.0).sum() - 3) + kappa / 2 * (J - 1) ** 2

    def stress(stretches):
        step = 1e-5 * np.eye(3)
        return np.array([(energy(stretches + e) - energy(stretches - e)) / 2e-5 for e in step])

    b = fsolve(lambda b: stress(np.array([a, b[0], b[0]]))[1], [0.8])[0]
    sheet = Sheet(NEO, H, beside, bulk_modulus=kappa)
    found = solve_history(strip, sheet, PULL, [0.3, 0.6], [1, 2])
    assert force(found)[-1] == pytest.approx(stress(np.array([a, b, b]))[0] * 2 * W * H, rel=1e-7)
    np.testing.assert_allclose(found.displacements[-1], found.points * [a - 1, b - 1], atol=1e-6)
    assert a * b * b > 1.02
    assert found.iterations.max() <= 6


def test_compressible_tends_to_incompressible():
    """The difference falls with 1 / kappa on a sheet that is not uniformly strained."""
    mesh = quads(Cross(), quarter=True, size_factor=4.0)
    loading = Loading.clamped(Cross.loaded, 30.0)
    limit = solve(mesh, NEO, loading, 2).reactions["right"][-1, 0]
    kappas = np.array([1e3, 2e3])
    off = [
        limit - solve_history(mesh, Sheet(NEO, bulk_modulus=k), loading, [0.5, 1], [1, 2]).reactions["right"][-1, 0]
        for k in kappas
    ]
    assert 0 < off[1] < off[0] < 1e-3 * limit
    assert off[0] / off[1] == pytest.approx(2, rel=0.02)


def test_gradient_along_y_averages_out(strip):
    """Side by side: every line of the strip has the same stretch, and the force is the integral of s(y)."""
    gradient = Gradient(0.0, 0.5, 2 * L)
    found = solve_history(strip, Sheet(NEO, H, (gradient,)), PULL, [0.5], [1.0])
    mean = 1 + 0.5 * (W / 2) / (2 * L)  # over the quarter that is meshed
    assert force(found)[0] == pytest.approx(uniaxial(NEO, 1.5)[0] * mean * 2 * W * H, rel=1e-8)


def test_gradient_along_x_in_series():
    """One after the other, held across: s(x) P(a(x)) is the same everywhere, and the stretches add up."""
    mesh = quads(Strip(half_length=L, half_width=W, far_size=2.5), quarter=True)
    loading = Loading({"right": (8.0, None), "top": (None, 0.0)})
    found = solve_history(mesh, Sheet(NEO, H, (Gradient(0.8, 0.0, 2 * L),)), loading, [0.5, 1.0], [1, 2])

    def stretch(P, x):
        return brentq(lambda a: nominal_stresses(NEO, a, 1.0)[0] * (1 + 0.8 * x / (2 * L)) - P, 0.5, 5)

    P = brentq(lambda P: quad(lambda x: stretch(P, x) - 1, 0, L)[0] - 8.0, 0.05, 1.0)
    assert force(found)[-1] == pytest.approx(P * 2 * W * H, rel=1e-6)
    moved = quad(lambda x: stretch(P, x) - 1, 0, 10.0)[0]
    np.testing.assert_allclose(found.evaluate([[10.0, 3.0]])[-1], [[moved, 0.0]], atol=1e-5)


def test_patch_is_a_gaussian():
    """Stored energy under one deformation gradient: the integral of s by error functions."""
    F = np.diag([1.3, 1.1])
    square = SquareSheet(half_length=5.0, half_width=5.0, far_size=1.0)
    patch = Patch(0.4, 1.0, -0.5, 2.0)

    def integral(centre):
        return 2.0 * np.sqrt(np.pi / 2) * (erf((5 - centre) / np.sqrt(8)) + erf((5 + centre) / np.sqrt(8)))

    ratio = affine(Sheet(NEO, H, (patch,)), F, square).energy() / affine(Sheet(NEO, H), F, square).energy()
    assert ratio == pytest.approx(1 + 0.4 * integral(1.0) * integral(-0.5) / 100, rel=1e-5)


def second_piola(a):
    """S11 of uniaxial tension, MPa."""
    return uniaxial(NEO, a)[0] / a


def test_viscous_ramp_and_relaxation(strip):
    """A ramp of 2 s to stretch 1.5, then rest: second order in the step on the ramp, exact at rest."""
    g, tau, rate = 0.4, 1.3, 0.25
    sheet = Sheet(NEO, H, prony=(Prony(g, tau),))
    times, factors = [1.0, 2.0, 2.7, 5.0], [0.25, 0.5, 0.5, 0.5]
    expected = [nominal_stress("uniaxial", 0.4, g, tau, rate, t)[0] for t in (1.0, 2.0)]
    error = []
    for substeps in (4, 8):
        found = force(solve_history(strip, sheet, PULL, factors, times, substeps)) / (2 * W * H)
        error.append(np.abs(found[:2] - expected).max() / expected[0])
    assert error[1] < 5e-4
    assert error[0] / error[1] == pytest.approx(4, rel=0.1)
    rest = 1.5 * second_piola(1.5)
    np.testing.assert_allclose(found[2:] - rest, (found[1] - rest) * np.exp([-0.7 / tau, -3.0 / tau]), rtol=1e-8)


@pytest.mark.parametrize("mode", ["pure_shear", "equibiaxial"])
def test_viscous_ramp_with_a_stress_across(mode):
    """A square moved homogeneously in 40 steps: the three-dimensional stress by quadrature, second order in the step."""
    g, tau, rate, end = 0.8, 1.3, 0.25, 2.0
    mesh = quads(SquareSheet(half_length=5.0, half_width=5.0, far_size=5.0))
    a = 1 + rate * end * np.arange(1, 41) / 40
    stretches = np.stack([a, a ** LATERAL[mode]], axis=1)
    motion = MeasuredMotion(("right", "top"), np.ones_like(mesh.points, bool), (stretches[:, None] - 1) * mesh.points)
    found = solve_history(
        mesh, Sheet(NEO, H, prony=(Prony(g, tau),)), motion, np.arange(1, 41) / 40, end * np.arange(1, 41) / 40
    )
    stress = np.array([found.reactions["right"][-1, 0], found.reactions["top"][-1, 1]]) / (10.0 * H)
    np.testing.assert_allclose(stress, nominal_stress(mode, 0.4, g, tau, rate, end), rtol=3e-4)


def test_branches_of_a_series_add_up(strip):
    """In uniaxial tension, where the deformation is that of one branch: overstresses, on a ramp and at rest."""
    times, factors, branches = [1.0, 2.0, 2.7, 5.0], [0.25, 0.5, 0.5, 0.5], (Prony(0.4, 1.3), Prony(0.25, 0.2))
    base, first, second, both = (
        force(solve_history(strip, Sheet(NEO, H, prony=some), PULL, factors, times, 4))
        for some in ((), branches[:1], branches[1:], branches)
    )
    np.testing.assert_allclose(both - base, (first - base) + (second - base), rtol=1e-7)


def test_viscosity_fast_and_slow(strip):
    """Q = g S where loading is fast against tau, none where it is slow."""
    base = force(solve_history(strip, Sheet(NEO, H), PULL, [0.5], [1.0]))
    fast, slow = (
        force(solve_history(strip, Sheet(NEO, H, prony=(Prony(0.3, tau),)), PULL, [0.5, 0.5], [1.0, 2.0])) / base
        for tau in (1e6, 1e-3)
    )
    assert fast[0] == pytest.approx(1.3, rel=1e-5)
    assert slow[1] == pytest.approx(1.0, rel=1e-8)


FACTORS = [0.2, 0.5, 0.3, 0.1, 0.4, 0.5, 0.8, 0.5]
LARGEST = [0.2, 0.5, 0.5, 0.5, 0.5, 0.5, 0.8, 0.8]


def test_mullins_softening_of_ogden_and_roxburgh(strip):
    """With x = I1 - 3 for the energy of a neo-Hookean sheet: the same as by the energy with m of half the shear modulus as much."""
    r, m, beta = 0.4, 0.15, 0.3
    found = solve_history(strip, Sheet(NEO, H, (Mullins(r, m, beta),)), PULL, FACTORS, np.arange(1, 9))
    damage = OgdenRoxburgh(erf(1 / beta) / r, 0.5 * NEO.shear_modulus * m, beta)
    by_energy = solve_history(strip, Sheet(NEO, H, (damage,)), PULL, FACTORS, np.arange(1, 9))
    np.testing.assert_allclose(force(found), force(by_energy), rtol=1e-7)
    stress, x = uniaxial(NEO, 1 + np.array(FACTORS))
    _, largest = uniaxial(NEO, 1 + np.array(LARGEST))
    softer = 1 - r * erf((largest - x) / (m + beta * largest)) / erf(1 / beta)
    np.testing.assert_allclose(force(found), stress * softer * 2 * W * H, rtol=1e-8)


def test_mullins_softening(strip):
    found = solve_history(strip, Sheet(NEO, H, (Mullins(0.3),)), PULL, FACTORS, np.arange(1, 9))
    stress, x = uniaxial(NEO, 1 + np.array(FACTORS))
    _, largest = uniaxial(NEO, 1 + np.array(LARGEST))
    np.testing.assert_allclose(force(found), stress * (1 - 0.3 * (1 - x / largest)) * 2 * W * H, rtol=5e-6)


def test_payne_softening(strip):
    found = solve_history(strip, Sheet(NEO, H, (Payne(0.5, 0.2),)), PULL, FACTORS, np.arange(1, 9))
    stress, _ = uniaxial(NEO, 1 + np.array(FACTORS))
    _, largest = uniaxial(NEO, 1 + np.array(LARGEST))
    np.testing.assert_allclose(force(found), stress * (1 + 0.5 * np.exp(-largest / 0.2)) * 2 * W * H, rtol=1e-8)


def test_permanent_set(strip):
    """Of networks formed in the middle of the steps; a sheet at rest again is in compression: it has become longer."""
    factors = [*FACTORS, 0.0]
    found = solve_history(strip, Sheet(NEO, H, permanent_set=PermanentSet(0.4)), PULL, factors, np.arange(1, 10))
    stretch, largest = 1 + np.array(factors), 1 + np.array([*LARGEST, 0.8])
    left = np.exp(-0.4 * uniaxial(NEO, largest)[1])
    broken = -np.diff(left, prepend=1.0)
    whole = np.concatenate([[1.0], stretch])
    along, across = (whole[1:] + whole[:-1]) / 2, (whole[1:] ** -0.5 + whole[:-1] ** -0.5) / 2
    A, lateral, thick = (np.cumsum([0.0, *(broken * v)])[:-1] for v in (along**-2, across**-2, (along * across) ** 2))

    def energy(a):
        def of(b):
            own = left * NEO.mu / 2 * (a**2 + b**2 + (a * b) ** -2 - 3)
            return own + NEO.mu / 2 * (a**2 * A + b**2 * lateral + thick / (a * b) ** 2)

        return of

    def slope(f, x, h=1e-5):
        return (f(x + h) - f(x - h)) / (2 * h)

    narrow = stretch**-0.5
    for _ in range(30):  # free across
        first = slope(energy(stretch), narrow)
        narrow = narrow - first / (
            (slope(energy(stretch), narrow + 1e-4) - slope(energy(stretch), narrow - 1e-4)) / 2e-4
        )
    expected = slope(lambda a: energy(a)(narrow), stretch)
    np.testing.assert_allclose(force(found), expected * 2 * W * H, rtol=1e-5, atol=1e-7)
    assert force(found)[-1] < 0


def test_additions_add_up(strip):
    """A gradient side by side, softened, with viscosity so slow that it multiplies the stress."""
    sheet = Sheet(NEO, H, (Gradient(0.0, 0.5, 2 * L), Mullins(0.3)), prony=(Prony(0.2, 1e7),))
    found = solve_history(strip, sheet, PULL, [0.5, 0.2], [1, 2])
    (_, stress), (largest, x) = np.transpose([uniaxial(NEO, a) for a in (1.5, 1.2)])
    expected = 1.2 * (1 + 0.5 * (W / 2) / (2 * L)) * stress * (1 - 0.3 * (1 - x / largest)) * 2 * W * H
    assert force(found)[-1] == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Fibres(np.nan, (0.1,)),
        lambda: Fibres(0.1, (0.1,), -0.5),
        lambda: Fibres(0.1, (0.1,), 0.5, 0.4),
        lambda: Mullins(0.3, -0.1, 0.2),
        lambda: Mullins(0.3, 0.1, 0.0),
        lambda: Fibres(0.1, (np.inf,)),
        lambda: Patch(0.1, 0, 0, 0.0),
        lambda: Payne(0.1, -1.0),
        lambda: Prony(0.1, 0.0),
        lambda: Sheet(NEO, 0.0),
        lambda: Sheet(NEO, bulk_modulus=-1.0),
        lambda: PermanentSet(-0.1),
        lambda: Sheet(NEO, permanent_set=PermanentSet(0.1), bulk_modulus=100.0),
    ],
)
def test_impossible_sheets(make):
    with pytest.raises(MaterialError):
        make()


@pytest.mark.parametrize(
    ("factors", "times"), [([1.0], [1.0, 2.0]), ([0.5, 1.0], [1.0, 1.0]), ([1.0], [0.0]), ([], [])]
)
def test_impossible_histories(strip, factors, times):
    with pytest.raises(LoadingError, match="times"):
        solve_history(strip, Sheet(NEO), PULL, factors, times)


def test_meshes_and_materials_that_do_not_fit_are_named(strip):
    triangle = triangles(Strip(half_length=L, half_width=W, far_size=10.0), quarter=True)
    with pytest.raises(LoadingError, match="quads"):
        solve_history(triangle, Sheet(NEO), PULL, [1.0], [1.0])
    with pytest.raises(MaterialError, match="thickness 1"):
        solve_history(strip, Sheet(Pann.from_dict({**MODEL, "unit": "N/mm"}), H), PULL, [1.0], [1.0])


def test_no_equilibrium_keeps_what_was_reached(strip):
    """Pushed through itself: the first increment is there."""
    with pytest.raises(ConvergenceError) as error:
        solve_history(strip, Sheet(NEO), PULL, [0.2, -1.5], [1, 2], options=Options(max_bisections=2))
    assert len(error.value.solution.time) == 1
    assert force(error.value.solution)[0] == pytest.approx(uniaxial(NEO, 1.2)[0] * 2 * W * 1.0, rel=1e-8)
