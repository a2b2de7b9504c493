"""The plane-stress cross in felupe: an independent assembly, with stress and tangent derived by hand."""

from typing import NamedTuple

import felupe
import numpy as np

# psi = mu sum_k c_k / N^(k-1) (I1^k - 3^k), Arruda-Boyce in five terms
TERMS = ((1, 1 / 2), (2, 1 / 20), (3, 11 / 1050), (4, 19 / 7000), (5, 519 / 673750))


class Result(NamedTuple):
    """Displacements (n, 2), mm; forces of the right and the top arm of the quarter, N; Newton iterations."""

    displacements: np.ndarray
    right: float
    top: float
    iterations: int


def _kinematics(F):
    """I1 = tr C + 1 / J^2, its slope G = 2 F - 2 J^-2 F^-T, F^-T and J^-2, for F (2, 2, ...)."""
    (a, b), (c, d) = F
    J = a * d - b * c
    cofactor = np.array([[d, -c], [-b, a]])
    return (F**2).sum((0, 1)) + J**-2.0, 2 * F - 2 * cofactor / J**3, cofactor / J, J**-2.0


def _stress(x, mu, N):
    I1, G, _, _ = _kinematics(x[0])
    slope = mu * sum(c * k * (I1 / N) ** (k - 1) for k, c in TERMS)
    return [slope * G, x[-1]]


def _tangent(x, mu, N):
    I1, G, T, inverse = _kinematics(x[0])
    slope = mu * sum(c * k * (I1 / N) ** (k - 1) for k, c in TERMS)
    curvature = mu * sum(c * k * (k - 1) * I1 ** (k - 2) / N ** (k - 1) for k, c in TERMS[1:])
    one = np.einsum("ik,jl->ijkl", np.eye(2), np.eye(2))[..., None, None]
    second = (
        2 * one
        + 4 * inverse * np.einsum("ij...,kl...->ijkl...", T, T)
        + 2 * inverse * np.einsum("il...,kj...->ijkl...", T, T)
    )
    return [curvature * np.einsum("ij...,kl...->ijkl...", G, G) + slope * second]


def sheet(mesh, material):
    """Field and solid body of a biquadratic mesh, 1 mm thick."""
    region = felupe.RegionBiQuadraticQuad(felupe.Mesh(mesh.points, mesh.cells, "quad9"))
    field = felupe.FieldContainer([felupe.Field(region, dim=2)])
    umat = felupe.Material(stress=_stress, elasticity=_tangent, mu=material.mu, N=material.N)
    return field, felupe.SolidBody(umat, field)


def solve(mesh, material, displacement, n_increments, **newton):
    """Quarter of a cross, arms clamped and moved outward."""
    field, solid = sheet(mesh, material)
    n = len(mesh.points)
    held = np.zeros((n, 2), bool)
    held[mesh.boundary_nodes("symmetry_x"), 0] = held[mesh.boundary_nodes("symmetry_y"), 1] = True
    right, top = mesh.boundary_nodes("right"), mesh.boundary_nodes("top")
    held[right] = held[top] = True
    dof0, dof1 = np.flatnonzero(held), np.flatnonzero(~held)
    iterations = 0
    options = {"tol": 1e-9, "verbose": 0, **newton}
    for t in np.arange(1, n_increments + 1) / n_increments:
        values = np.zeros((n, 2))
        values[right, 0] = values[top, 1] = t * displacement
        result = felupe.newtonrhapson(items=[solid], dof0=dof0, dof1=dof1, ext0=values.ravel()[dof0], **options)
        iterations += result.iterations
    forces = solid.assemble.vector(field).toarray().reshape(n, 2)
    return Result(field[0].values, forces[right, 0].sum(), forces[top, 1].sum(), iterations)
