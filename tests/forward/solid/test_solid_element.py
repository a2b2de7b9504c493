"""The compiled hex against UFL's derivatives of the potential, and against its own energy by Taylor's theorem."""

import numpy as np
import pytest
from orders import taylor_rates
from solid_helpers import MATERIALS, block, on_face, problem_on

from forward import NeoHooke
from forward._dolfinx import dolfinx, ufl
from forward.compilation import compiled_form
from forward.solid import pardiso
from forward.solid.element import CENTRE, PRESSURES
from forward.solid.solid_forms import centre_function, potential, pressure_basis
from forward.solid.solid_problem import node_order

KAPPA = 50.0


@pytest.fixture(scope="module", params=MATERIALS.values(), ids=MATERIALS)
def state(request):
    """A distorted block, clamped below, with a state that is far from equilibrium: problem, u (n, 3), q (m, 4)."""
    return disturbed(request.param)


def disturbed(material, solver="pardiso"):
    mesh = block(n=(2, 1), layers=1)
    problem = problem_on(mesh, material, KAPPA, on_face(mesh.points, 2, 0), solver)
    x, y, z = problem.mesh.points[problem.nodes].T
    rng = np.random.default_rng(4)
    problem.u = np.column_stack([0.4 * x + 0.1 * y * z, -0.15 * y + 0.1 * np.sin(x), -0.2 * z + 0.1 * x * y])
    problem.u += 0.01 * rng.standard_normal(problem.u.shape)
    problem.q = 0.3 * rng.standard_normal(problem.q.shape)
    return problem, material


class Mixed:
    """The potential of the same state in UFL: its derivatives as dense arrays, in the local order of the problem."""

    def __init__(self, problem, material):
        domain, self.V = problem.domain, problem.V
        Q = dolfinx.fem.functionspace(domain, ("DG", 0, (PRESSURES,)))
        u, q = dolfinx.fem.Function(self.V), dolfinx.fem.Function(Q)
        u.x.array[:] = problem.u.ravel()
        self.order = Q.dofmap.list[:, 0]
        q.x.array.reshape(-1, PRESSURES)[self.order] = problem.q
        basis = pressure_basis(domain, centre_function(domain, np.argsort(node_order())))
        parameters = dolfinx.fem.Constant(domain, np.array(material.parameters))
        kappa = dolfinx.fem.Constant(domain, KAPPA)
        self.energy = potential(u, ufl.dot(q, basis), material, parameters, kappa, domain)
        self.fields = {"u": u, "q": q}

    def assembled(self, *names):
        """The derivative of the energy to the named fields."""
        form = self.energy
        for name in names:
            form = ufl.derivative(form, self.fields[name])
        form = compiled_form(form)
        if len(names) == 1:
            return dolfinx.fem.assemble_vector(form).array
        A = dolfinx.fem.petsc.assemble_matrix(form)
        A.assemble()
        return A.convert("dense").getDenseArray().copy()

    def by_cell(self, values):
        """Rows of the pressure, one block of four for each hex."""
        return values.reshape(-1, PRESSURES)[self.order]


def test_forces_are_those_of_the_potential(state):
    problem, material = state
    expected = Mixed(problem, material).assembled("u").reshape(-1, 3)
    forces, _, inverted = problem.solid.forces(problem.u, problem.q)
    assert inverted == 0
    np.testing.assert_allclose(forces, expected, atol=1e-12 * np.abs(expected).max())


def test_volume_equation_is_that_of_the_potential():
    """With du = 0 the step of the pressure solves its own equation; the squared error is what that costs."""
    problem, material = disturbed(NeoHooke())
    mixed = Mixed(problem, material)
    e, K = mixed.assembled("q"), mixed.assembled("q", "q")
    expected = mixed.by_cell(np.linalg.solve(K, -e))
    dq = problem.solid.pressure_step(problem.u, problem.q, np.zeros_like(problem.u))
    np.testing.assert_allclose(dq, expected, atol=1e-11 * np.abs(expected).max())
    _, squared, _ = problem.solid.forces(problem.u, problem.q)
    assert squared == pytest.approx(-e @ np.linalg.solve(K, e) / KAPPA, rel=1e-11)


def monolithic_step(problem, material, jump):
    """Newton step of displacement and pressure from the undivided, indefinite system."""
    mixed = Mixed(problem, material)
    Kuu, Kuq, Kqq = mixed.assembled("u", "u"), mixed.assembled("u", "q"), mixed.assembled("q", "q")
    K = np.block([[Kuu, Kuq], [Kuq.T, Kqq]])
    residual = np.concatenate([mixed.assembled("u"), mixed.assembled("q")])
    held = np.concatenate([problem.held.ravel(), np.zeros(problem.q.size, bool)])
    step = np.concatenate([jump.ravel(), np.zeros(problem.q.size)])
    free = ~held
    step[free] = np.linalg.solve(K[np.ix_(free, free)], -residual[free] - K[np.ix_(free, held)] @ step[held])
    n = problem.u.size
    return step[:n].reshape(-1, 3), mixed.by_cell(step[n:])


def check_condensed_step(problem, material, tolerance=1e-10):
    jump = np.where(problem.held, 0.05 * np.random.default_rng(5).standard_normal(problem.u.shape), 0.0)
    expected_u, expected_q = monolithic_step(problem, material, jump)
    du = problem.linear.step(problem.u, problem.q, jump, fresh=True)
    dq = problem.solid.pressure_step(problem.u, problem.q, du)
    np.testing.assert_allclose(du, expected_u, atol=tolerance * np.abs(expected_u).max())
    np.testing.assert_allclose(dq, expected_q, atol=tolerance * np.abs(expected_q).max())


WITH_BOTH_INVARIANTS = MATERIALS["mooney_rivlin"]  # the others are slow to compile


def test_condensed_step_is_the_monolithic_one():
    check_condensed_step(*disturbed(WITH_BOTH_INVARIANTS, "mumps"))


@pytest.mark.parametrize(
    ("fresh", "tolerance"),
    [((1e-7, 30), 1e-5), ((1e-13, 100), 1e-10), ((0.0, 0), 1e-10)],
    ids=["as it is", "more iterations", "factor in float64"],
)
def test_iterated_step_is_the_monolithic_one(monkeypatch, fresh, tolerance):
    """PARDISO's factor in float32 with conjugate gradients, to their accuracy; without them its factor in float64."""
    monkeypatch.setattr(pardiso, "FRESH", fresh)
    check_condensed_step(*disturbed(WITH_BOTH_INVARIANTS, "pardiso"), tolerance)


@pytest.mark.slow
def test_condensed_step_is_the_monolithic_one_for_each_material(state, monkeypatch):
    monkeypatch.setattr(pardiso, "FRESH", (1e-13, 100))
    check_condensed_step(*state)


def test_one_hex_at_a_time(state):
    """Element matrices are symmetric, and add up to the matrix that PARDISO is given."""
    problem, _ = state
    m, n = problem.solid.n_cells, problem.u.size
    matrices, forces = problem.solid.matrices(0, m, problem.u, problem.q)
    np.testing.assert_allclose(matrices, matrices.transpose(0, 2, 1), atol=1e-12 * np.abs(matrices).max())
    K, g = np.zeros((n, n)), np.zeros(n)
    for dofs, matrix, force in zip(problem.solid.dofs, matrices, forces, strict=True):
        rows = (3 * dofs[:, None] + np.arange(3)).ravel()
        K[np.ix_(rows, rows)] += matrix
        g[rows] += force
    held = problem.held.ravel()
    problem.linear.step(problem.u, problem.q, np.zeros_like(problem.u), fresh=True)
    upper = problem.linear.matrix.toarray()
    free = np.ix_(~held, ~held)
    np.testing.assert_allclose(upper[free], np.triu(K)[free], atol=1e-12 * np.abs(K).max())
    np.testing.assert_array_equal(upper[held][:, held], np.eye(held.sum()))
    assert not upper[held][:, ~held].any() and not upper[~held][:, held].any()


# Taylor: the pressure that goes with u makes the potential a function of u alone, with slope g and curvature K


def with_pressure(problem, u):
    """The pressure that solves the volume equation at u, and the energy, nodal forces and tangent there."""
    q = np.zeros_like(problem.q)
    q = q + problem.solid.pressure_step(u, q, np.zeros_like(u))
    problem.u, problem.q = u, q
    return problem.energy(), problem.solid.forces(u, q)[0], q


def tangent_times(problem, u, q, d):
    matrices, _ = problem.solid.matrices(0, problem.solid.n_cells, u, q)
    product = np.zeros_like(d)
    for dofs, matrix in zip(problem.solid.dofs, matrices, strict=True):
        product[dofs] += (matrix @ d[dofs].ravel()).reshape(-1, 3)
    return product


@pytest.fixture
def expansion(state):
    """Energy, forces and tangent in a direction, at the state, with the state put back."""
    problem, _ = state
    u, q = problem.u, problem.q
    d = 0.05 * np.random.default_rng(6).standard_normal(u.shape)
    E, f, p = with_pressure(problem, u)
    yield problem, u, d, E, f, tangent_times(problem, u, p, d)
    problem.u, problem.q = u, q


def test_forces_are_the_slope_of_the_energy(expansion):
    problem, u, d, E, f, _ = expansion
    rates = taylor_rates(lambda s: with_pressure(problem, u + s * d)[0] - E - s * (f * d).sum(), 3)
    np.testing.assert_allclose(rates[-1], 2, atol=0.1)


def test_tangent_is_the_slope_of_the_forces(expansion):
    problem, u, d, _, f, Kd = expansion
    rates = taylor_rates(lambda s: np.linalg.norm(with_pressure(problem, u + s * d)[1] - f - s * Kd), 3)
    np.testing.assert_allclose(rates[-1], 2, atol=0.1)


def test_energy_to_second_order(expansion):
    problem, u, d, E, f, Kd = expansion
    slope, curvature = (f * d).sum(), (Kd * d).sum()
    rates = taylor_rates(lambda s: with_pressure(problem, u + s * d)[0] - E - s * slope - s**2 / 2 * curvature, 3)
    np.testing.assert_allclose(rates[-1], 3, atol=0.15)


def test_forces_balance(state):
    """Nodal forces of any state sum to zero, and so do their moments about the deformed nodes."""
    problem, _ = state
    forces, _, _ = problem.solid.forces(problem.u, problem.q)
    scale = np.abs(forces).sum()
    np.testing.assert_allclose(forces.sum(axis=0), 0, atol=1e-12 * scale)
    x = problem.mesh.points[problem.nodes] + problem.u
    np.testing.assert_allclose(np.cross(x, forces).sum(axis=0), 0, atol=1e-11 * scale)


def test_nothing_changes_under_a_rotation(state):
    """A rotation of the deformed body turns the forces with it and leaves energy and volume alone."""
    problem, _ = state
    angle = 0.7
    R = np.array([[np.cos(angle), -np.sin(angle), 0], [0, 0, -1.0], [np.sin(angle), np.cos(angle), 0]])
    X, u = problem.mesh.points[problem.nodes], problem.u
    forces, volume, _ = problem.solid.forces(u, problem.q)
    E = problem.energy()
    problem.u = (X + u) @ R.T - X
    turned, turned_volume, _ = problem.solid.forces(problem.u, problem.q)
    np.testing.assert_allclose(turned, forces @ R.T, atol=1e-12 * np.abs(forces).max())
    assert turned_volume == pytest.approx(volume, rel=1e-12)
    assert problem.energy() == pytest.approx(E, rel=1e-12)
    problem.u = u


def test_inside_out_is_counted(state):
    """One hex pushed through itself, and a number that is none, are both told."""
    problem, _ = state
    u = problem.u.copy()
    u[problem.solid.dofs[0, CENTRE]] += 2.0
    assert problem.solid.forces(u, problem.q)[2] >= 1
    u[problem.solid.dofs[0, CENTRE]] = np.nan
    assert problem.solid.forces(u, problem.q)[2] >= 1
