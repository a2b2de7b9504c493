"""Distorted blocks, prescribed paths and exact states for the tests of the solid."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from forward_helpers import MATERIALS as CLASSICAL
from forward_helpers import energy_derivatives

from forward import Pann
from forward._dolfinx import MPI
from forward.solid_problem import SolidProblem
from meshes import Mesh, SolidMesh, extrude
from meshes.mesh import QUAD_NODES
from meshes.solid import HEX_NODES, hex_shape_gradients, hex_shapes

# a network of both invariants: scales, energy scale, W and b of a layer of two, output, skip
CENTRE = int(np.flatnonzero((HEX_NODES == 0).all(axis=1))[0])
PANN = Pann("I1I2", (2,), (0.3, 0.1, 0.8, 0.6, 0.2, 0.1, 0.7, -0.3, 0.2, 0.5, 0.9, 0.4, 0.2))
MATERIALS = {**CLASSICAL, "pann": PANN}


@dataclass(frozen=True, eq=False)
class MovedMesh(SolidMesh):
    """Hexes whose nodes are moved by `shift` (n, 3), mm, away from planes and columns."""

    shift: np.ndarray | float = 0.0

    @cached_property
    def points(self):
        return SolidMesh.points.func(self) + self.shift

    def volume(self):
        return float(places(self, 3)[2].sum())


def grid(n, size):
    """Plane mesh of n = (nx, ny) rectangles on 0 <= x <= size[0], 0 <= y <= size[1], named as a quarter is."""
    x, y = (np.linspace(0, s, 2 * m + 1) for s, m in zip(size, n, strict=True))
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    number = np.arange(len(points)).reshape(len(x), len(y))
    i, j = (k.ravel() for k in np.meshgrid(*(2 * np.arange(m) for m in n), indexing="ij"))
    steps = QUAD_NODES.astype(int) + 1
    cells = number[i[:, None] + steps[:, 0], j[:, None] + steps[:, 1]]
    sides = {"right": number[-1], "top": number[:, -1], "symmetry_x": number[0], "symmetry_y": number[:, 0]}
    edges = {name: np.column_stack([s[:-2:2], s[2::2], s[1::2]]) for name, s in sides.items()}
    return Mesh(points, cells, "quad", edges)


def jitter(shape, rng, straight=False):
    """Random numbers (layers, nx, ny, 3) in [-1, 1], zero across the outer faces; shape: nodes along each direction.

    straight: drawn for the corners of the hexes, the middles of their edges follow.
    """
    cells = [slice(None, None, 2 if straight else 1)] * 3
    shift = np.zeros((*shape, 3))
    shift[*cells] = rng.uniform(-1, 1, shift[*cells].shape)
    for axis, component in ((0, 2), (1, 0), (2, 1)):
        np.moveaxis(shift, axis, 0)[[0, -1], ..., component] = 0
        if straight:
            along = np.moveaxis(shift, axis, 0)
            along[1::2] = (along[:-1:2] + along[2::2]) / 2
    return shift.reshape(-1, 3)


def block(n=(2, 2), layers=2, size=(2.0, 1.5), thickness=2.0, ragged=0.15, seed=0, whole=False):
    """Block of curved, irregular hexes; nodes of its faces, edges and corners stay on them."""
    mesh = extrude(grid(n, size), thickness, layers, whole=whole)
    spacing = np.array([size[0] / (2 * n[0]), size[1] / (2 * n[1]), np.diff(mesh.levels).min()])
    random = jitter((len(mesh.levels), 2 * n[0] + 1, 2 * n[1] + 1), np.random.default_rng(seed))
    return MovedMesh(mesh.plane, mesh.levels, mesh.symmetric, ragged * spacing * random)


def sector(n, ragged=0.2, seed=0):
    """Sector of a tube, 1 <= R <= 2, 0 <= Theta <= 1, 0 <= Z <= 1, of n^3 hexes that are no bricks, however fine."""
    straight = extrude(grid((n, n), (1.0, 1.0)), 2.0, n, grading=1.0)
    shift = ragged / n * jitter((2 * n + 1,) * 3, np.random.default_rng(seed), straight=True)
    R, Theta, Z = (straight.points + shift + [1.0, 0.0, 0.0]).T
    points = np.column_stack([R * np.cos(Theta), R * np.sin(Theta), Z])
    return MovedMesh(straight.plane, straight.levels, True, points - straight.points)


class SwollenAndTwisted:
    """Universal deformation of a tube, r^2 = R^2 + b, theta = Theta + twist Z, z = Z, with no traction at R = 1.

    It keeps the volume, and needs no body force in any isotropic incompressible material (Ericksen 1954).
    """

    def __init__(self, material, b=0.6, twist=0.5):
        self.material, self.b, self.twist = material, b, twist

    def displacement(self, X, t=1.0):
        """Displacements (..., 3), mm, at X (..., 3), mm, for a part t of the load."""
        R, Theta, Z = np.hypot(X[..., 0], X[..., 1]), np.arctan2(X[..., 1], X[..., 0]), X[..., 2]
        r, theta = np.sqrt(R**2 + t * self.b), Theta + t * self.twist * Z
        return np.stack([r * np.cos(theta), r * np.sin(theta), Z], axis=-1) - X

    def deformation_gradient(self, X):
        """F (..., 3, 3): that in the frame of the tube, between a turn by -Theta and one by theta."""
        R, Theta = np.hypot(X[..., 0], X[..., 1]), np.arctan2(X[..., 1], X[..., 0])
        return _turn(Theta + self.twist * X[..., 2]) @ self._local(R) @ np.swapaxes(_turn(Theta), -1, -2)

    def pressure(self, X):
        """p (...), MPa, from the radial equilibrium d(sigma_rr)/dr = (sigma_tt - sigma_rr) / r."""
        R = np.hypot(X[..., 0], X[..., 1])
        x, w = np.polynomial.legendre.leggauss(16)
        at = 1 + (R[..., None] - 1) * (x + 1) / 2
        S = self._extra_stress(at)
        radial_stress = ((S[..., 1, 1] - S[..., 0, 0]) * at / (at**2 + self.b)) @ w * (R - 1) / 2
        S = self._extra_stress(R)
        return radial_stress - S[..., 0, 0] + np.trace(S, axis1=-2, axis2=-1) / 3

    def _extra_stress(self, R):
        """2 psi_1 B + 2 psi_2 (I1 B - B^2), MPa, (..., 3, 3) in the frame r, theta, z."""
        F = self._local(R)
        B = F @ np.swapaxes(F, -1, -2)
        I1 = np.trace(B, axis1=-2, axis2=-1)[..., None, None]
        psi1, psi2 = energy_derivatives(self.material, I1)
        return 2 * psi1 * B + 2 * psi2 * (I1 * B - B @ B)

    def _local(self, R):
        r, zero, one = np.sqrt(R**2 + self.b), np.zeros_like(R), np.ones_like(R)
        F = [[R / r, zero, zero], [zero, r / R, self.twist * r], [zero, zero, one]]
        return np.moveaxis(np.array(F), (0, 1), (-2, -1))


def _turn(angle):
    """Rotations (..., 3, 3) about z."""
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return np.moveaxis(np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]]), (0, 1), (-2, -1))


def on_face(points, axis, end):
    """Which nodes lie on the lowest (0) or the highest (1) coordinate."""
    x = points[:, axis]
    return np.abs(x - (x.max() if end else x.min())) < 1e-9


def on_rim(mesh):
    """Which nodes of a block lie on its outside."""
    return np.any([on_face(mesh.points, axis, end) for axis in range(3) for end in (0, 1)], axis=0)


def problem_on(mesh, material, kappa=None, held=None, solver="pardiso", tolerance=1e-11, volume_tolerance=1e-13):
    """A problem with the nodes `held` (n,) prescribed; all of the rim by default."""
    held = on_rim(mesh) if held is None else held
    kappa = 1e4 * material.shear_modulus if kappa is None else kappa
    where = np.repeat(held[:, None], 3, axis=1) if held.ndim == 1 else held
    values = np.zeros_like(mesh.points)
    return SolidProblem(mesh, material, kappa, where, values, tolerance, volume_tolerance, 25, solver, MPI.COMM_SELF)


def follow(problem, path, n_steps):
    """Move the held nodes along the displacement `path(X, t)`, t from 0 to 1, to equilibrium."""
    for t in np.arange(1, n_steps + 1) / n_steps:
        problem.values = path(problem.mesh.points, t)[problem.nodes]
        outcome = problem.solve(1.0)
        assert outcome.converged, f"t = {t}: {outcome.text}"
    return problem.unknowns


def places(mesh, n):
    """n^3 Gauss points of each hex: local places (k, 3), points (m, k, 3), mm, and weights (m, k), mm^3."""
    x, w = np.polynomial.legendre.leggauss(n)
    local = np.array([(a, b, c) for c in x for b in x for a in x])
    weights = np.array([a * b * c for c in w for b in w for a in w])
    J = np.einsum("qnk,mni->mqik", hex_shape_gradients(local), mesh.points[mesh.cells])
    points = np.einsum("qn,mni->mqi", hex_shapes(local), mesh.points[mesh.cells])
    return local, points, weights * np.linalg.det(J)


def displacement_at(mesh, u, local):
    """Displacements (m, k, 3), mm, and their gradients (m, k, 3, 3) at local places (k, 3) of each hex."""
    slopes = hex_shape_gradients(local)
    back = np.linalg.inv(np.einsum("qnk,mni->mqik", slopes, mesh.points[mesh.cells]))
    gradients = np.einsum("mni,qnk,mqkj->mqij", u[mesh.cells], slopes, back, optimize=True)
    return np.einsum("qn,mni->mqi", hex_shapes(local), u[mesh.cells]), gradients


def pressure_at(mesh, q, points):
    """Pressure (m, k), MPa, at points (m, k, 3), mm, of each hex."""
    return q[:, :1] + np.einsum("mki,mi->mk", points - mesh.points[mesh.cells[:, CENTRE]][:, None], q[:, 1:])


def pressure_jumps(mesh, q):
    """Differences (f,), MPa, of the pressures of two neighbours in the middle of the face between them."""
    middles = mesh.cells[:, np.flatnonzero((HEX_NODES != 0).sum(axis=1) == 1)]
    values = pressure_at(mesh, q, mesh.points[middles]).ravel()
    order = np.argsort(middles.ravel(), kind="stable")
    nodes, values = middles.ravel()[order], values[order]
    shared = nodes[1:] == nodes[:-1]
    return np.diff(values)[shared]
