"""Finite viscoelasticity with a multiplicative split: against the evolution equation, solved by scipy, and its limits.

The reference is written in the elastic stretches of a branch: in a state with fixed principal axes, ln le_k' = ln l_k' - (le_k^2 - mean) / (2 tau).
"""

import numpy as np
import pytest
from forward_helpers import nominal_stresses
from interrupted import interrupted
from scipy.integrate import solve_ivp

from forward import Loading, NeoHooke
from forward.errors import MaterialError
from forward.loading import MeasuredMotion
from forward.sheet.inelastic import solve_history
from forward.sheet.multiplicative_viscosity import MaxwellBranch, flowed, step
from forward.sheet.thin_sheet import Prony, Sheet
from meshes import PlateWithHole, SquareSheet, quads

NEO, H, SIDE = NeoHooke(0.4), 1.5, 5.0
BRANCHES = (MaxwellBranch(0.3, 1.3), MaxwellBranch(0.15, 0.2))
LATERAL = {"uniaxial": -0.5, "pure shear": 0.0, "equi-biaxial": 1.0}
RATE, RAMP = 0.4, 2.0  # 1/s, s: to a stretch of 1.8, then held


def stretch(t):
    return 1 + RATE * np.minimum(t, RAMP)


def reference(mode, times):
    """Nominal stresses (t, 2) of base and branches, MPa, P33 = 0; every branch at scipy's tightest tolerance."""
    share = np.array([1.0, LATERAL[mode], -1.0 - LATERAL[mode]])
    a = stretch(times)
    in_plane = np.stack([a, a ** LATERAL[mode]], axis=1)
    total = np.stack(nominal_stresses(NEO, *in_plane.T), axis=1)
    for branch in BRANCHES:

        def rate(t, strain, tau=branch.tau):
            squares = np.exp(2 * strain)
            pull = RATE / stretch(t) * share if t < RAMP else 0 * share
            return pull - (squares - squares.mean()) / (2 * tau)

        up = solve_ivp(rate, (0, RAMP), np.zeros(3), rtol=1e-12, atol=1e-13, dense_output=True)
        hold = solve_ivp(rate, (RAMP, 20.0), up.y[:, -1], rtol=1e-12, atol=1e-13, dense_output=True)
        squares = np.exp(2 * np.where(times <= RAMP, up.sol(times), hold.sol(np.maximum(times, RAMP)))).T
        total += branch.mu * (squares[:, :2] - squares[:, 2:]) / in_plane
    return total


def stresses(mode, times, sheet):
    """The same by a square moved homogeneously, one step between times."""
    mesh = quads(SquareSheet(SIDE, SIDE, far_size=2 * SIDE))
    a = stretch(times)
    in_plane = np.stack([a, a ** LATERAL[mode]], axis=1)
    motion = MeasuredMotion(("right", "top"), np.ones_like(mesh.points, bool), (in_plane[:, None] - 1) * mesh.points)
    found = solve_history(mesh, sheet, motion, np.arange(1, len(times) + 1) / len(times), times)
    return np.stack([found.reactions["right"][:, 0], found.reactions["top"][:, 1]], axis=1) / (2 * SIDE * H)


def test_a_sheet_takes_the_steps_of_a_point():
    """Pure shear in three steps, two branches: the stress of the base and of the law of a point, step after step."""
    times, past, expected = np.array([1.0, 2.0, 3.0]), [np.eye(2) for _ in BRANCHES], []
    before = np.eye(2)
    for a in stretch(times):
        F = np.diag([a, 1.0])
        half = [flowed(branch, before, A, 0.5) for branch, A in zip(BRANCHES, past, strict=True)]
        ends = [step(branch, F, A, 1.0) for branch, A in zip(BRANCHES, half, strict=True)]
        past, before = [end.past for end in ends], F
        expected.append(np.add(nominal_stresses(NEO, a, 1.0), sum(np.diag(end.stress) for end in ends)))
    np.testing.assert_allclose(stresses("pure shear", times, Sheet(NEO, H, branches=BRANCHES)), expected, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("mode", LATERAL)
def test_sheet_follows_the_evolution_equation(mode):
    """Of second order in the step: two branches, ramp and rest."""

    def error(n):
        times = np.arange(1, n + 1) * 4.0 / n
        expected = reference(mode, times)
        found = stresses(mode, times, Sheet(NEO, H, branches=BRANCHES))
        return np.linalg.norm(found - expected) / np.linalg.norm(expected)

    coarse, fine = error(16), error(32)
    assert coarse / fine > 3.5
    assert fine < 3e-4


def test_the_law_of_a_point_converges_to_the_evolution_equation():
    """Of second order; extrapolated from 400 steps, 1e-6 of the stress, along a path with turning axes that scipy follows in C_i."""
    branch = BRANCHES[0]

    def gradient(t):
        return np.eye(2) + t * np.array([[0.35, 0.3], [-0.1, -0.05]])

    def rate(t, flat):
        A = flat.reshape(2, 2)
        b = gradient(t) @ A @ gradient(t).T
        deviator = b - np.eye(2) * (np.trace(b) + 1 / np.linalg.det(b)) / 3
        back = np.linalg.inv(gradient(t))
        return (-(back @ deviator @ b @ back.T) / branch.tau).ravel()

    A = solve_ivp(rate, (0, 2), np.eye(2).ravel(), rtol=1e-12, atol=1e-13).y[:, -1].reshape(2, 2)
    F = gradient(2.0)
    b = F @ A @ F.T
    expected = branch.mu * (b - np.eye(2) / np.linalg.det(b)) @ np.linalg.inv(F).T

    def found(n):
        past = np.eye(2)
        for k in range(n):
            half = flowed(branch, gradient(2.0 * k / n), past, 1.0 / n)
            end = step(branch, gradient(2.0 * (k + 1) / n), half, 2.0 / n)
            past = end.past
        return end.stress

    one, two, four = (found(n) for n in (100, 200, 400))
    assert np.abs(one - expected).max() / np.abs(two - expected).max() == pytest.approx(4, rel=0.05)
    np.testing.assert_allclose((4 * four - two) / 3, expected, atol=1e-6 * np.abs(expected).max())


def test_tangent_is_the_derivative_and_nearly_symmetric():
    rng = np.random.default_rng(0)
    F, past = np.eye(2) + rng.normal(0, 0.25, (6, 2, 2)), np.eye(2)
    F[0], F[1] = np.diag([1.3, 1.3]), np.diag([1.3, 1.3 + 1e-6])
    end = step(BRANCHES[0], F, past, 0.7)
    h = 1e-6
    for i in range(2):
        for j in range(2):
            e = h * np.outer(np.eye(2)[i], np.eye(2)[j])
            slope = (step(BRANCHES[0], F + e, past, 0.7).stress - step(BRANCHES[0], F - e, past, 0.7).stress) / (2 * h)
            np.testing.assert_allclose(end.tangent[..., i, j], slope, atol=1e-8)
    off = np.abs(end.tangent - np.einsum("...ijmn->...mnij", end.tangent)).max()
    assert 1e-6 < off < 0.02 * np.abs(end.tangent).max()  # of the second order in the step; a solver must know


def test_fast_and_slow():
    """All of a branch's spring in a step that is short beside tau, nothing of it after a long rest."""
    F = np.diag([1.8, 0.7])
    spring = np.array(nominal_stresses(NeoHooke(0.3), 1.8, 0.7))
    fast, slow = (step(MaxwellBranch(0.3, tau), F, np.eye(2), 1.0) for tau in (1e9, 1e-9))
    np.testing.assert_allclose(np.diag(fast.stress), spring, rtol=1e-8)
    np.testing.assert_allclose(slow.stress, 0, atol=1e-8)
    np.testing.assert_allclose(F @ slow.past @ F.T, np.eye(2), atol=1e-8)


def test_a_small_step_is_the_linear_law():
    """A Maxwell element after a jump and half a step, backward Euler extrapolated, to the first order in the strain."""
    F = np.eye(2) + 1e-6 * np.array([[0.7, 0.2], [-0.4, 0.1]])
    found, spring = (step(MaxwellBranch(0.3, tau), F, np.eye(2), 0.5).stress for tau in (1.3, 1e12))
    z = 0.25 / 1.3
    np.testing.assert_allclose(found, (2 / (1 + z / 2) ** 2 - 1 / (1 + z)) * spring, rtol=1e-5, atol=1e-12)


@pytest.mark.slow
def test_small_strain_is_the_finite_linear_law():
    """Simo's law with g = mu of the branch / mu of the base: the overstresses differ by the square of the strain in pure shear, whose stress is odd in it."""
    times = np.arange(1, 41) * 0.1
    mesh = quads(SquareSheet(SIDE, SIDE, far_size=2 * SIDE), quarter=True)
    split, linear = Sheet(NEO, H, branches=(MaxwellBranch(0.3, 1.3),)), Sheet(NEO, H, prony=(Prony(0.75, 1.3),))

    def difference(size):
        loading = Loading({"right": (size * SIDE, None), "top": (None, 0.0)})
        factors = np.minimum(times / RAMP, 1.0)

        def force(law, substeps):
            return solve_history(mesh, law, loading, factors, times, substeps).reactions["right"][:, 0]

        over = force(linear, 8) - force(Sheet(NEO, H), 1)
        off = force(split, 8) - force(linear, 8)
        return np.abs(off).max() / over.max()

    small, twice = difference(0.03), difference(0.06)
    assert small < 1e-3
    assert twice / small == pytest.approx(4, rel=0.1)


@pytest.mark.slow
def test_a_plate_with_a_hole_relaxes_and_a_run_that_was_cut_off_goes_on(tmp_path):
    mesh = quads(PlateWithHole(), quarter=True, size_factor=4.0)
    loading, sheet = Loading.clamped(PlateWithHole.loaded, 20.0), Sheet(NEO, H, branches=BRANCHES)

    def run(**keywords):
        return solve_history(mesh, sheet, loading, [0.5, 1.0, 1.0, 0.4], [1.0, 2.0, 4.0, 5.0], 2, **keywords)

    whole = run()
    assert whole.iterations.max() <= 14  # of two substeps: the tangent is that of the step
    assert whole.reactions["right"][1, 0] > whole.reactions["right"][2, 0]
    with interrupted(2):
        run(checkpoint=tmp_path / "run.npz")
    again = run(checkpoint=tmp_path / "run.npz")
    np.testing.assert_array_equal(again.displacements, whole.displacements)
    assert again.history.keys() == {"branch_0", "branch_1", "branches_F"}
    for name, values in whole.history.items():
        np.testing.assert_array_equal(again.history[name], values)


@pytest.mark.parametrize(
    "make",
    [
        lambda: MaxwellBranch(-0.1, 1.0),
        lambda: MaxwellBranch(0.1, 0.0),
        lambda: Sheet(NEO, bulk_modulus=100.0, branches=BRANCHES),
    ],
)
def test_impossible_values(make):
    with pytest.raises(MaterialError):
        make()
