"""Exact finite-element data for the tests: a perforated plate, solved with the kinematics it is measured with.

In: an energy of the invariants. Out: an `Experiment` whose displacements are in equilibrium on their own mesh: linear
test functions against the stress of gradients and areas from `calibrate.recovery` (what that is worth is tested in
test_recovery.py), or of plain linear triangles, as the paper's loss has them. The solver shares nothing else with
`calibrate`: energies are written in F again and differentiated here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from calibrate import recovery
from calibrate.experiment import Experiment, LoadedBoundary, Noise

Array = NDArray[np.float64]
Energy = Callable[[jax.Array], jax.Array]


@dataclass(frozen=True)
class MooneyRivlin:
    """psi = c10 (I1 - 3) + c01 (I2 - 3), MPa."""

    c10: float = 0.1
    c01: float = 0.03

    def __call__(self, invariants: jax.Array) -> jax.Array:
        return self.c10 * (invariants[0] - 3) + self.c01 * (invariants[1] - 3)


@dataclass(frozen=True)
class HartmannNeff:
    """psi = c1 (I1 - 3) + c2 (I2^(3/2) - 3^(3/2)), MPa: polyconvex (2003), so that a PANN can represent it."""

    c1: float = 0.1
    c2: float = 0.01

    def __call__(self, invariants: jax.Array) -> jax.Array:
        return self.c1 * (invariants[0] - 3) + self.c2 * (invariants[1] ** 1.5 - 3**1.5)


@dataclass(frozen=True)
class ArrudaBoyce:
    """Five-term series of Arruda and Boyce 1993 in I1, MPa; coefficients from Steinmann et al. 2012."""

    mu: float = 0.2698
    N: float = 21.49

    def __call__(self, invariants: jax.Array) -> jax.Array:
        terms = enumerate((1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750), start=1)
        return self.mu * sum(c / self.N ** (k - 1) * (invariants[0] ** k - 3.0**k) for k, c in terms)


def derivatives(energy: Energy, invariants: Array) -> Array:
    """d psi / d(I1, I2) (..., 2) at invariants (..., 2)."""
    flat = jnp.asarray(invariants).reshape(-1, 2)
    return np.asarray(jax.vmap(jax.grad(energy))(flat)).reshape(invariants.shape)


def energy_of_gradient(energy: Energy) -> Callable[[jax.Array], jax.Array]:
    """psi(F) of an incompressible sheet in plane stress, F (2, 2): I1 and I2 written out in 3D."""

    def psi(F: jax.Array) -> jax.Array:
        C = F.T @ F
        C33 = 1.0 / (C[0, 0] * C[1, 1] - C[0, 1] * C[1, 0])
        full = jnp.zeros((3, 3)).at[:2, :2].set(C).at[2, 2].set(C33)
        first = jnp.trace(full)
        return energy(jnp.stack([first, 0.5 * (first**2 - jnp.trace(full @ full))]))

    return psi


def plate(n_theta: int = 40, n_radial: int = 7, half_length: float = 30.0, radius: float = 8.0):
    """Square plate with a round hole, meshed in rings: points (n, 2) mm, triangles (m, 3), ring index (n,)."""
    theta = 2 * np.pi * (np.arange(n_theta) + 0.5) / n_theta - np.pi / 4 - np.pi / n_theta
    circle = radius * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    square = half_length * circle / np.abs(circle).max(axis=1, keepdims=True)
    s = (np.arange(n_radial + 1) / n_radial)[:, None, None] ** 1.3
    points = ((1 - s) * circle + s * square).reshape(-1, 2)
    i, j = np.meshgrid(np.arange(n_radial), np.arange(n_theta), indexing="ij")
    a, b = (i * n_theta + j).ravel(), (i * n_theta + (j + 1) % n_theta).ravel()
    c, d = a + n_theta, b + n_theta
    triangles = np.concatenate([np.stack([a, c, d], axis=1), np.stack([a, d, b], axis=1)])
    return points, triangles, np.repeat(np.arange(n_radial + 1), n_theta)


class Sheet:
    """Equilibrium of a sheet on triangles, thickness 1 mm: nodal forces and their tangent.

    free: nodes of free edges, for recovered kinematics; None for linear triangles.
    """

    def __init__(self, points: Array, triangles: NDArray[np.int64], energy: Energy, free: Array | None = None) -> None:
        x = points[triangles]
        edges = np.stack([x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]], axis=2)
        slopes = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]]) @ np.linalg.inv(edges)
        rows = np.broadcast_to(np.arange(2 * len(x)).reshape(-1, 1, 2), slopes.shape).ravel()
        columns = np.repeat(triangles.ravel(), 2)
        self.gradient = linear = sp.csr_array((slopes.ravel(), (rows, columns)), shape=(2 * len(x), len(points)))
        areas = 0.5 * np.linalg.det(edges)
        if free is not None:
            self.gradient = recovery.centroid_gradients(points, triangles)
            areas = recovery.areas(points, triangles, free)
        self.work = sp.csr_array((sp.diags_array(np.repeat(areas, 2)) @ linear).T)
        psi = energy_of_gradient(energy)
        self._stress = jax.jit(jax.vmap(jax.grad(psi)))
        self._modulus = jax.jit(jax.vmap(jax.hessian(psi)))

    def deformation_gradients(self, u: Array) -> Array:
        """F (m, 2, 2) of displacements u (n, 2), mm."""
        return np.eye(2) + (self.gradient @ u).reshape(-1, 2, 2).swapaxes(1, 2)

    def forces(self, u: Array) -> Array:
        """Internal nodal forces (n, 2), N, at displacements u (n, 2), mm."""
        P = np.asarray(self._stress(self.deformation_gradients(u)))
        return self.work @ P.swapaxes(1, 2).reshape(-1, 2)

    def tangent(self, u: Array) -> sp.csc_array:
        """d forces / du (2 n, 2 n), N/mm, degrees of freedom x0, y0, x1, ...; symmetric for linear triangles."""
        modulus = np.asarray(self._modulus(self.deformation_gradients(u)))
        m, n = len(modulus), len(u)
        rows = np.repeat(np.arange(2 * m), 2)
        columns = np.tile(np.arange(2 * m).reshape(m, 1, 2), (1, 2, 1)).ravel()
        total = sp.csr_array((2 * n, 2 * n))
        for i, k in np.ndindex(2, 2):
            part = sp.csr_array((modulus[:, i, :, k, :].ravel(), (rows, columns)), shape=(2 * m, 2 * m))
            place = np.zeros((2, 2))
            place[i, k] = 1.0
            total = total + sp.kron(self.work @ part @ self.gradient, place)
        return sp.csc_array(total)

    def solve(self, start: Array, prescribed: NDArray[np.bool_]) -> Array:
        """Equilibrium (n, 2) from `start`, whose `prescribed` (n,) nodes stay; free forces below 1e-12 N."""
        free = np.flatnonzero(np.repeat(~prescribed, 2))
        u = start.copy()
        for _ in range(50):
            residual = self.forces(u).ravel()[free]
            if np.abs(residual).max() < 1e-12:
                return u
            step = splu(self.tangent(u)[free][:, free]).solve(residual)
            u.ravel()[free] -= step
            if np.abs(step).max() < 1e-12:
                return u
        raise RuntimeError("the test sheet did not converge")


@cache
def plate_experiment(
    energy: Energy = ArrudaBoyce(),
    pull: float = 18.0,
    n_increments: int = 3,
    n_theta: int = 40,
    n_radial: int = 7,
    linear: bool = False,
) -> Experiment:
    """The plate gripped left and right and pulled apart by `pull` mm at each side; forces of both grips.

    linear: with the kinematics of linear triangles.
    """
    points, triangles, ring = plate(n_theta, n_radial)
    outer, half = ring == ring.max(), points[:, 0].max()
    left, right = (outer & np.isclose(points[:, 0], x) for x in (-half, half))
    grips = left | right
    free = np.flatnonzero((outer & ~grips) | (ring == 0))
    sheet = Sheet(points, triangles, energy, None if linear else free)
    displacements, forces = [], []
    previous = np.zeros_like(points)
    for i in range(n_increments):
        level = (i + 1) / n_increments
        start = previous + points * [pull / half / n_increments, 0.0]
        start[grips] = np.sign(points[grips]) * [pull * level, 0.0]
        previous = sheet.solve(start, grips)
        displacements.append(previous)
        nodal = sheet.forces(previous)
        forces.append([nodal[left].sum(axis=0), nodal[right].sum(axis=0)])
    force = np.array(forces)
    loaded = tuple(
        LoadedBoundary(name, np.flatnonzero(nodes), force[:, k])
        for k, (name, nodes) in enumerate((("left", left), ("right", right)))
    )
    return Experiment("plate", points, triangles, np.array(displacements), loaded, free, 1.0)


def with_noise(experiment: Experiment, noise: Noise, seed: int) -> Experiment:
    """Add correlated displacement noise and force noise drawn from `noise`.

    The symmetric root of the covariance is unique; with eigenvectors alone, a seed would give other noise on another machine.
    """
    rng = np.random.default_rng(seed)
    distance2 = ((experiment.points[:, None] - experiment.points[None]) ** 2).sum(axis=2)
    covariance = np.exp(-distance2 / (2 * noise.correlation_length**2))
    values, vectors = np.linalg.eigh(covariance)
    factor = noise.displacement_std * (vectors * np.sqrt(np.maximum(values, 0))) @ vectors.T
    shape = experiment.displacements.shape
    u = np.einsum("na,tak->tnk", factor, rng.standard_normal((shape[0], factor.shape[1], 2)))
    loaded = tuple(replace(b, force=noisy_force(b.force, noise, rng)) for b in experiment.loaded)
    return replace(experiment, displacements=experiment.displacements + u, loaded=loaded, noise=noise)


def noisy_force(force: Array, noise: Noise, rng: np.random.Generator) -> Array:
    """Independent normal noise of every component, as the weighting assumes."""
    std = noise.force_std_relative * np.abs(force) + noise.force_std
    return force + std * rng.standard_normal(force.shape)


def renumbered(experiment: Experiment, seed: int = 0) -> Experiment:
    """The same data with nodes and triangles in another order."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(experiment.points))
    new = np.argsort(order)
    triangles = np.roll(new[experiment.triangles], 1, axis=1)[rng.permutation(len(experiment.triangles))]
    return replace(
        experiment,
        points=experiment.points[order],
        triangles=triangles,
        displacements=experiment.displacements[:, order],
        loaded=tuple(replace(b, nodes=new[b.nodes]) for b in experiment.loaded),
        free_nodes=new[experiment.free_nodes],
    )


def moved(experiment: Experiment, angle: float = 0.7, shift: tuple[float, float] = (3.0, -2.0)) -> Experiment:
    """The same deformation seen after a rigid rotation and translation: x' = Q x + shift, F' = Q F."""
    Q = rotation(angle)
    x = experiment.points + experiment.displacements
    return replace(
        experiment,
        displacements=x @ Q.T + np.asarray(shift) - experiment.points,
        loaded=tuple(replace(b, force=b.force @ Q.T) for b in experiment.loaded),
    )


def rotation(angle: float) -> Array:
    """Rotation (2, 2) by `angle` (rad), counter-clockwise."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def random_gradients(n: int, seed: int = 0, spread: float = 0.35) -> Array:
    """Random in-plane deformation gradients (n, 2, 2) with det F in [0.3, 3]."""
    rng = np.random.default_rng(seed)
    F = np.eye(2) + spread * rng.standard_normal((20 * n, 2, 2))
    det = np.linalg.det(F)
    return F[(det > 0.3) & (det < 3.0)][:n]
