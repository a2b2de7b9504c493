"""Orders of convergence of the elements, and consistency of energy, forces and tangent."""

import numpy as np
import pytest
from forward_helpers import MATERIALS, annulus, in_triangles
from orders import taylor_rates

from calibrate.equations.basis import SingleBasis
from calibrate.equations.splines import pieces_of
from forward import ArrudaBoyce, Loading
from forward._dolfinx import MPI, dolfinx, ufl
from forward.compilation import compiled_problem
from forward.materials import Ogden
from forward.materials.spline_energy import SplineEnergy
from forward.sheet.additions import MooneyPart
from forward.sheet.inelastic_problem import InelasticProblem
from forward.sheet.plane_stress_problem import (
    NOT_A_NUMBER,
    PETSC_OPTIONS,
    PlaneStressProblem,
    create_domain,
    invariants,
    stored_energy,
)
from forward.sheet.thin_sheet import Sheet
from meshes import Cross, quads

COMM = MPI.COMM_SELF


def manufactured_errors(mesh):
    """Errors (L2, H1) on curved cells, for a load that makes a chosen smooth displacement the solution."""
    material = ArrudaBoyce()
    domain = create_domain(mesh, COMM)
    V = dolfinx.fem.functionspace(domain, ("Lagrange", 2, (2,)))
    u, v, X = dolfinx.fem.Function(V), ufl.TestFunction(V), ufl.SpatialCoordinate(domain)
    exact = ufl.as_vector([0.1 * ufl.sin(2 * X[0]) * X[1], 0.05 * ufl.cos(2 * X[1]) * X[0] ** 2])
    F = ufl.variable(ufl.Identity(2) + ufl.grad(exact))
    P = ufl.diff(material.energy(*invariants(F)), F)
    load = ufl.inner(P, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 8})
    residual = ufl.derivative(stored_energy(u, material, domain, 1.0), u, v) - load
    u.interpolate(dolfinx.fem.Expression(exact, V.element.interpolation_points))
    domain.topology.create_connectivity(1, 2)
    rim = dolfinx.mesh.exterior_facet_indices(domain.topology)
    prescribed = u.copy()
    bc = dolfinx.fem.dirichletbc(prescribed, dolfinx.fem.locate_dofs_topological(V, 1, rim))
    u.x.array[:] *= 0.9
    options = {**PETSC_OPTIONS, "snes_rtol": 1e-12, "snes_atol": 1e-13}
    problem = compiled_problem(
        residual,
        u,
        bcs=[bc],
        petsc_options_prefix=f"manufactured_{mesh.cell_type}_{len(mesh.cells)}_",
        petsc_options=options,
    )
    problem.solve()
    assert problem.solver.getConvergedReason() > 0, problem.solver.getConvergedReason()
    error = u - exact
    dx = ufl.dx(metadata={"quadrature_degree": 8})
    norms = ufl.inner(error, error) * dx, ufl.inner(ufl.grad(error), ufl.grad(error)) * dx
    return [dolfinx.fem.assemble_scalar(dolfinx.fem.form(norm)) ** 0.5 for norm in norms]


@pytest.mark.parametrize(("cells", "coarsest"), [(lambda mesh: mesh, 4), (in_triangles, 8)], ids=["quads", "triangles"])
def test_elements_converge_at_their_orders(cells, coarsest):
    errors = np.array([manufactured_errors(cells(annulus(coarsest * k))) for k in (1, 2, 4)])
    rates = np.log2(errors[:-1] / errors[1:])
    assert rates[:, 0].min() >= 2.8
    assert rates[:, 1].min() >= 1.9


BASIS = SingleBasis(0, 1.2, 9)
PIECES = pieces_of(0.1 + 0.05 * np.sin(np.arange(9.0)))
SPLINE = SplineEnergy(BASIS.top, tuple(map(tuple, PIECES.tolist())))
SHEETS = {
    "sheet of a spline": Sheet(SPLINE, 1.3, (MooneyPart(0.03),)),
    "sheet of both invariants": Sheet(Ogden(), 1.3),
}


@pytest.fixture(scope="module", params=[*MATERIALS.values(), *SHEETS.values()], ids=[*MATERIALS, *SHEETS])
def stretched(request):
    """A stretched cross, not in equilibrium, and a random direction."""
    mesh = quads(Cross(), quarter=True, size_factor=4.0)
    held, values = Loading.clamped(Cross.loaded, 30.0).on(mesh).prescribed(mesh)
    if isinstance(request.param, Sheet):
        problem = InelasticProblem(mesh, request.param, held, values, 1e-10, 25, COMM)
    else:
        problem = PlaneStressProblem(mesh, request.param, 1.3, held, values, 1e-10, 25, COMM)
    x, y = mesh.points.T / 100
    u = np.column_stack([30 * x + 3 * np.sin(3 * y), 20 * y + 2 * x * y])
    direction = np.random.default_rng(3).standard_normal(mesh.points.shape)
    return problem, u, 0.2 * direction


def energy_at(problem, u):
    problem.unknowns = (u,)
    return problem.energy()


def forces_at(problem, u):
    problem.unknowns = (u,)
    return problem.nodal_forces()


def tangent_times(problem, u, direction):
    """K(u) d without supports, as nodal values (n, 2)."""
    problem.unknowns = (u,)
    K = dolfinx.fem.petsc.assemble_matrix(problem.problem.J)
    K.assemble()
    x, y = K.createVecs()
    x.setArray(direction[problem.nodes].ravel())
    K.mult(x, y)
    assert K.isSymmetric(tol=1e-10)
    product = np.zeros_like(direction)
    product[problem.nodes] = y.getArray().reshape(-1, 2)
    return product


def test_forces_are_the_slope_of_the_energy(stretched):
    problem, u, d = stretched
    E, slope = energy_at(problem, u), (forces_at(problem, u) * d).sum()
    rates = taylor_rates(lambda s: energy_at(problem, u + s * d) - E - s * slope, 6)
    np.testing.assert_allclose(rates[-1], 2, atol=0.1)


def test_tangent_is_the_slope_of_the_forces(stretched):
    problem, u, d = stretched
    R, Kd = forces_at(problem, u), tangent_times(problem, u, d)
    rates = taylor_rates(lambda s: np.linalg.norm(forces_at(problem, u + s * d) - R - s * Kd), 6)
    np.testing.assert_allclose(rates[-1], 2, atol=0.1)


def test_energy_to_second_order(stretched):
    problem, u, d = stretched
    E, slope = energy_at(problem, u), (forces_at(problem, u) * d).sum()
    curvature = (tangent_times(problem, u, d) * d).sum()
    rates = taylor_rates(lambda s: energy_at(problem, u + s * d) - E - s * slope - s**2 / 2 * curvature, 6)
    np.testing.assert_allclose(rates[-1], 3, atol=0.15)


def test_forces_balance(stretched):
    """Internal forces of any state sum to zero, and so do their moments in the deformed configuration."""
    problem, u, _ = stretched
    forces = forces_at(problem, u)
    scale = np.abs(forces).sum()
    np.testing.assert_allclose(forces.sum(axis=0), 0, atol=1e-12 * scale)
    x = problem.mesh.points + u
    assert abs((x[:, 0] * forces[:, 1] - x[:, 1] * forces[:, 0]).sum()) < 1e-10 * scale


def test_not_a_number_is_refused(stretched):
    problem, u, _ = stretched
    problem.unknowns = (np.full_like(u, np.nan),)
    outcome = problem.solve(0.1)
    assert not outcome.converged
    assert outcome.reason == NOT_A_NUMBER
