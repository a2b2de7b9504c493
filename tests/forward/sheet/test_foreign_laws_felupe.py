"""Sheets of foreign laws with a hole, assembled by felupe from stresses that are computed here another way: every node is in equilibrium.

Displacements are those of the sheet. Stresses at felupe's Gauss points are slopes of the textbook energies by central differences, and those of a
branch follow the evolution equation of Ci by a Runge-Kutta scheme, not its exponential map.
"""

import felupe
import numpy as np
import pytest
from scipy.special import erf

from forward import Loading, NeoHooke
from forward.materials import Ogden
from forward.sheet.damage_and_dispersion import DispersedFibres, OgdenRoxburgh
from forward.sheet.inelastic import solve_history
from forward.sheet.multiplicative_viscosity import MaxwellBranch
from forward.sheet.thin_sheet import Sheet
from meshes import PlateWithHole, quads

H, FIBRES, DAMAGE = 1.5, DispersedFibres(0.08, 0.5, 0.1, (0.5, -0.5)), OgdenRoxburgh(1.8, 0.08, 0.1)
LOADING = Loading.clamped(PlateWithHole.loaded, 25.0)
STEP = 1e-5

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def mesh():
    return quads(PlateWithHole(), quarter=True, size_factor=4.0)


class Assembly:
    """Felupe's Gauss points of a mesh: F (..., 2, 2) of displacements, and nodal forces (n, 2), N, of stresses."""

    def __init__(self, mesh):
        self.region = felupe.RegionBiQuadraticQuad(felupe.Mesh(mesh.points, mesh.cells, "quad9"))
        self.field = felupe.FieldContainer([felupe.Field(self.region, dim=2)])

    def gradients(self, u):
        self.field[0].values[:] = u
        return np.moveaxis(self.field.extract(grad=True, add_identity=True, sym=False)[0], (0, 1), (-2, -1))

    def forces(self, P):
        whole = [np.moveaxis(H * P, (-2, -1), (0, 1))]
        return felupe.IntegralForm(whole, self.field, self.region.dV).assemble().toarray().reshape(-1, 2)


def off_balance(found, mesh, nodal):
    """Largest imbalance of a free component and largest error of the grip's force, over the grip's force."""
    right = mesh.boundary_nodes("right")
    free = np.ones(nodal.shape, bool)
    free[right] = free[mesh.boundary_nodes("symmetry_x"), 0] = free[mesh.boundary_nodes("symmetry_y"), 1] = False
    return np.abs(nodal[free]).max() / found[0], abs(nodal[right, 0].sum() / found[0] - 1)


def energy(F):
    """Of Ogden's base and the fibres, MPa, F (..., 2, 2)."""
    C = np.swapaxes(F, -1, -2) @ F
    squares = np.concatenate([np.linalg.eigvalsh(C), 1 / np.linalg.det(C)[..., None]], axis=-1)
    psi = sum(m / a * ((squares ** (a / 2)).sum(-1) - 3) for m, a in np.reshape(Ogden().parameters, (3, 2)))
    for angle in FIBRES.angles:
        M = np.array([np.cos(angle), np.sin(angle)])
        I4 = np.einsum("i,...ij,j->...", M, C, M)
        E = FIBRES.kappa * (squares.sum(-1) - 3) + (1 - 3 * FIBRES.kappa) * (I4 - 1)
        psi = psi + FIBRES.k1 / (2 * FIBRES.k2) * np.expm1(FIBRES.k2 * np.maximum(E, 0) ** 2)
    return psi


def slope(F):
    """Of the energy by F, by central differences."""
    found = np.zeros_like(F)
    for i in range(2):
        for j in range(2):
            e = STEP * np.outer(np.eye(2)[i], np.eye(2)[j])
            found[..., i, j] = (energy(F + e) - energy(F - e)) / (2 * STEP)
    return found


def test_ogden_with_dispersed_fibres_and_damage(mesh):
    """Loaded, unloaded and loaded beyond; damage by the largest energy so far of each Gauss point."""
    sheet = Sheet(Ogden(), H, (FIBRES, DAMAGE))
    found = solve_history(mesh, sheet, LOADING, [0.4, 0.8, 0.3, 1.0], [1, 2, 3, 4])
    assembly, largest = Assembly(mesh), 0.0
    for u, reaction in zip(found.displacements, found.reactions["right"], strict=True):
        F = assembly.gradients(u)
        W = energy(F)
        largest = np.maximum(largest, W)
        eta = 1 - erf((largest - W) / (DAMAGE.m + DAMAGE.beta * largest)) / DAMAGE.r
        imbalance, error = off_balance(reaction, mesh, assembly.forces(eta[..., None, None] * slope(F)))
        assert imbalance < 1e-7
        assert error < 1e-7
    assert eta.min() == 1  # the last load is beyond all others


def flow(A, F, tau):
    """Rate of A = Ci^-1 in the plane of an incompressible branch: -F^-1 dev(b) b F^-T / tau, b = F A F^T."""
    b, back = F @ A @ np.swapaxes(F, -1, -2), np.linalg.inv(F)
    mean = (np.trace(b, axis1=-2, axis2=-1) + 1 / np.linalg.det(b)) / 3
    return -back @ (b - mean[..., None, None] * np.eye(2)) @ b @ np.swapaxes(back, -1, -2) / tau


def runge_kutta(A, start, end, tau, duration, steps=4):
    """A at the end of an increment along which F goes straight from `start` to `end`."""
    h = duration / steps
    for k in range(steps):
        first, middle, last = (start + (k + s) / steps * (end - start) for s in (0, 0.5, 1))
        k1 = flow(A, first, tau)
        k2 = flow(A + h / 2 * k1, middle, tau)
        k3 = flow(A + h / 2 * k2, middle, tau)
        A = A + h / 6 * (k1 + 2 * k2 + 2 * k3 + flow(A + h * k3, last, tau))
    return A


def test_two_branches_with_a_multiplicative_split(mesh):
    """A ramp and a rest: what the nodes are out of balance falls with the second power of the step."""
    base, branches = NeoHooke(0.4), (MaxwellBranch(0.3, 1.3), MaxwellBranch(0.15, 0.4))

    def errors(n):
        times = np.arange(1, n + 1) * 3.0 / n
        found = solve_history(mesh, Sheet(base, H, branches=branches), LOADING, np.minimum(times / 2, 1.0), times)
        assembly = Assembly(mesh)
        before, past = assembly.gradients(np.zeros_like(mesh.points)), [np.eye(2) for _ in branches]
        for u in found.displacements:
            F = assembly.gradients(u)
            past = [runge_kutta(A, before, F, b.tau, 3.0 / n) for A, b in zip(past, branches, strict=True)]
            before = F
        P = 0
        for mu, A in [(base.mu, np.eye(2)), *((b.mu, A) for b, A in zip(branches, past, strict=True))]:
            b = F @ A @ np.swapaxes(F, -1, -2)
            tau = mu * (b - np.eye(2) / np.linalg.det(b)[..., None, None])
            P = P + tau @ np.swapaxes(np.linalg.inv(F), -1, -2)
        return off_balance(found.reactions["right"][-1], mesh, assembly.forces(P))

    coarse, fine = errors(30), errors(60)
    assert max(fine) < 3e-3
    assert coarse[1] / fine[1] > 3.3
