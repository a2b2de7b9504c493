"""The three-dimensional cross in felupe: triquadratic hexes with a discontinuous linear pressure, all by hand.

psi(I1bar) + p (J - 1) - p^2 / (2 kappa); stress and tangent are written out below, displacement and pressure are
solved for together. The pressure of a hex is linear in its own coordinates r, s, t, as is usual, or in x, y, z as ours.
"""

import importlib.util
from typing import NamedTuple

import felupe
import numpy as np
from forward_felupe import TERMS

from meshes import SolidMesh
from meshes.solid import HEX_NODES


class Result(NamedTuple):
    """Displacements (n, 3), mm; pressure (m, 4), MPa: q0 + q1 r + q2 s + q3 t in each hex, or q0 + q . (X - Xc);
    forces of the right and the top arm, of the whole thickness, N; Newton iterations."""

    displacements: np.ndarray
    pressure: np.ndarray
    right: float
    top: float
    iterations: int


class LinearPressure:
    """1, r, s, t on a hex: an element of felupe."""

    points = np.zeros((4, 3))

    def function(self, rst):
        return np.array([1.0, *rst])

    def gradient(self, rst):
        return np.vstack([np.zeros(3), np.eye(3)])


def node_order():
    """For each node of felupe's hex its number in the mesh's hex."""
    points = felupe.TriQuadraticHexahedron().points
    return np.array([int(np.flatnonzero((x == HEX_NODES).all(axis=1))[0]) for x in points])


def _kinematics(F):
    """J, F^-T and I1 for F (3, 3, ...)."""
    J = felupe.math.det(F)
    return J, felupe.math.transpose(felupe.math.inv(F, determinant=J)), (F**2).sum((0, 1))


def _slopes(I1bar, mu, N):
    """First and second derivative of the Arruda-Boyce energy."""
    first = mu * sum(c * k * (I1bar / N) ** (k - 1) for k, c in TERMS)
    second = mu * sum(c * k * (k - 1) * I1bar ** (k - 2) / N ** (k - 1) for k, c in TERMS[1:])
    return first, second


def _stress(x, mu, N, kappa):
    F, p = x[0], x[1][0]
    J, T, I1 = _kinematics(F)
    first, _ = _slopes(J ** (-2 / 3) * I1, mu, N)
    P = 2 * first * J ** (-2 / 3) * (F - I1 / 3 * T) + p * J * T
    return [P, (J - 1 - p / kappa)[None], x[-1]]


def _tangent(x, mu, N, kappa):
    """d2W / dF dF, d2W / dF dp, d2W / dp dp.

    With G = d I1bar / dF = 2 J^(-2/3) (F - I1/3 T), T = F^-T and dT_ij / dF_kl = -T_il T_kj:
    d2 I1bar = 2 J^(-2/3) (1 - 2/3 (F x T + T x F) + 2/9 I1 T x T + I1/3 T_il T_kj).
    """
    F, p = x[0], x[1][0]
    J, T, I1 = _kinematics(F)
    scale = J ** (-2 / 3)
    first, second = _slopes(scale * I1, mu, N)
    G = 2 * scale * (F - I1 / 3 * T)
    a = 2 * first * scale

    def dyad(A, B):
        return np.einsum("ij...,kl...->ijkl...", A, B)

    K = dyad(second * G, G)
    K -= dyad(2 / 3 * a * F, T) + dyad(2 / 3 * a * T, F)
    K += dyad((2 / 9 * a * I1 + p * J) * T, T)
    K += np.einsum("il...,kj...->ijkl...", (a * I1 / 3 - p * J) * T, T)
    for i in range(3):
        for j in range(3):
            K[i, j, i, j] += a
    return [K, J * T, np.full_like(x[1], -1 / kappa)]


def body(mesh: SolidMesh, material, kappa, mapped=True):
    """Fields of displacement and pressure, and the solid body, on the hexes of a mesh; material: Arruda-Boyce.

    mapped: the pressure is linear in r, s, t of each hex, or else in x, y, z.
    """
    cells = mesh.cells[:, node_order()]
    region = felupe.RegionTriQuadraticHexahedron(felupe.Mesh(mesh.points, cells, "hexahedron27"))
    numbers = np.arange(4 * len(cells)).reshape(-1, 4)
    pressures = felupe.Mesh(np.zeros((numbers.size, 3)), numbers, "pressure")
    linear = felupe.Region(pressures, LinearPressure(), region.quadrature, grad=False)
    if not mapped:
        places = np.einsum("aq,cai->iqc", region.element_h, mesh.points[cells])
        places -= mesh.points[cells[:, -1]].T[:, None]
        linear.h = np.concatenate([np.ones_like(places[:1]), places])
    field = felupe.FieldContainer([felupe.Field(region, dim=3), felupe.Field(linear)])
    umat = felupe.Material(stress=_stress, elasticity=_tangent, mu=material.mu, N=material.N, kappa=kappa)
    return field, felupe.SolidBody(umat, field)


def fastest_solver():
    """PARDISO where it is installed, felupe's own choice otherwise."""
    if importlib.util.find_spec("pypardiso") is None:
        return {}
    from pypardiso import spsolve

    return {"solver": spsolve}


def solve(mesh: SolidMesh, material, displacement, n_increments, kappa, mapped=True, **newton):
    """Eighth of a cross, its arms held in the plane and moved outward by `displacement`, mm; thickness free."""
    field, solid = body(mesh, material, kappa, mapped)
    n = len(mesh.points)
    held = np.zeros((n, 3), bool)
    for axis, cut in enumerate(("symmetry_x", "symmetry_y", "symmetry_z")):
        held[mesh.boundary_nodes(cut), axis] = True
    right, top = mesh.boundary_nodes("right"), mesh.boundary_nodes("top")
    held[right, :2] = held[top, :2] = True
    prescribed = np.concatenate([held.ravel(), np.zeros(4 * len(mesh.cells), bool)])
    dof0, dof1 = np.flatnonzero(prescribed), np.flatnonzero(~prescribed)
    iterations = 0
    options = {"tol": 1e-9, "verbose": 0, **fastest_solver(), **newton}
    for t in np.arange(1, n_increments + 1) / n_increments:
        values = np.zeros((n, 3))
        values[right, 0] = values[top, 1] = t * displacement
        ext0 = values.ravel()[dof0]
        result = felupe.newtonrhapson(items=[solid], dof0=dof0, dof1=dof1, ext0=ext0, **options)
        iterations += result.iterations
    forces = 2 * solid.assemble.vector(field).toarray()[: 3 * n].reshape(n, 3)
    pressure = field[1].values.reshape(-1, 4)
    return Result(field[0].values, pressure, forces[right, 0].sum(), forces[top, 1].sum(), iterations)
