"""The limit of small strains: Young's modulus and Poisson's ratio of a linear elastic plate with a hole, solved by felupe.

After the re-identification of Roemer, Hartmann, Troeger, Anton, Wessels, Flaschel, De Lorenzis 2025, Appl. Mech. Rev. 77, 040801
(github.com/troegerj/calibration-paper): a quarter of a plate, 10 mm long, in plane stress, pulled by a uniform traction; white noise of
2e-4 and 4e-4 mm on the displacements. The middle of their ranges is taken for the parameters, E = 210 GPa and nu = 0.3; the radius of
2 mm and the traction of 100 MPa are ours. Out: relative errors.

A plane state of linear elasticity is the same in plane stress and plane strain but for lambda, which is E nu / (1 - nu^2) in plane
stress. So the plate is calibrated in plane strain, and lambda = kappa - 2 mu / 3 gives E and nu.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import felupe
import numpy as np
import scipy.sparse.linalg
from beside import classical_fit
from beside.published_laws import CLASSICAL
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment, LoadedBoundary, Noise
from calibrate.errors import FitError
from calibrate.fitting.calibration import Options, calibrate
from meshes import Mesh, quads
from meshes.specimens import PlateWithHole

Array = NDArray[np.float64]
YOUNG, POISSON = 210e3, 0.3  # MPa
EDGE, RADIUS, TRACTION = 10.0, 2.0, 100.0  # mm, mm, MPa
NOISES = (0.0, 2e-4, 4e-4)  # mm
AROUND = np.array([0, 4, 1, 5, 2, 6, 3, 7])  # nodes of a nine-node quad, counter-clockwise; 8 is its middle


def solve(size_factor: float) -> tuple[Mesh, Array]:
    """A quarter in biquadratic quads, and displacements (n, 2), mm, by felupe."""
    plate = PlateWithHole(EDGE, EDGE, far_size=1.0, hole_radius=RADIUS, hole_size=0.35)
    mesh = quads(plate, quarter=True, size_factor=size_factor)
    field = felupe.FieldContainer(
        [felupe.Field(felupe.RegionBiQuadraticQuad(felupe.Mesh(mesh.points, mesh.cells, "quad9")), dim=2)]
    )
    solid = felupe.SolidBody(felupe.LinearElasticPlaneStress(E=YOUNG, nu=POISSON), field)
    stiffness = solid.assemble.matrix(field).tocsr()
    loads = np.zeros_like(mesh.points)
    for first, last, middle in mesh.boundaries["right"]:  # Simpson's rule is the work of a uniform traction
        length = np.linalg.norm(mesh.points[last] - mesh.points[first])
        loads[[first, last, middle], 0] += TRACTION * length * np.array([1, 1, 4]) / 6
    free = np.ones(mesh.points.shape, bool)
    free[mesh.boundary_nodes("symmetry_x"), 0] = free[mesh.boundary_nodes("symmetry_y"), 1] = False
    inner = np.flatnonzero(free)
    u = np.zeros(mesh.points.size)
    u[inner] = scipy.sparse.linalg.spsolve(stiffness[inner][:, inner], loads.ravel()[inner])
    return mesh, u.reshape(-1, 2)


def measured(mesh: Mesh, u: Array, noise: float, seed: int) -> Experiment:
    """Its nodes seen by a camera with white noise, mm; sides of symmetry slide."""
    triangles = np.concatenate([mesh.cells[:, [AROUND[k], AROUND[(k + 1) % 8], 8]] for k in range(8)])
    force = TRACTION * EDGE
    sides = {"symmetry_x": (0, -force), "right": (0, force), "symmetry_y": (1, 0.0)}
    loaded = []
    for name, (k, value) in sides.items():
        reaction = np.zeros((1, 2))
        reaction[0, k] = value
        loaded.append(LoadedBoundary(name, mesh.boundary_nodes(name), reaction, (k == 0, k == 1)))
    held = np.concatenate([side.nodes for side in loaded])
    error = np.random.default_rng(seed).normal(0, 1, u.shape) * noise
    return Experiment(
        name="linear elastic plate with a hole",
        points=mesh.points,
        triangles=triangles,
        displacements=(u + error)[None],
        loaded=tuple(loaded),
        free_nodes=np.setdiff1d(mesh.boundary_nodes("free"), held),
        thickness=1.0,
        noise=Noise(noise) if noise else None,
        plane="strain",
    )


def constants(mu: float, kappa: float) -> dict[str, float]:
    """E, MPa, and nu in plane stress of moduli found in plane strain, with relative errors."""
    ratio = kappa / mu - 2 / 3
    nu = ratio / (2 + ratio)
    E = 2 * mu * (1 + nu)
    return {"E": E, "nu": nu, "E_error": E / YOUNG - 1, "nu_error": nu / POISSON - 1}


def identify(experiment: Experiment) -> list[dict[str, Any]]:
    """By the network, and by two constants with the same weights."""
    start = time.process_time()
    try:
        found = calibrate(experiment, Options(inputs="I1", starts=3))
    except FitError as error:
        return [{"method": "network", "refused": str(error)}]
    seconds = time.process_time() - start
    mu = float(2 * found.model.derivatives(np.array([[3.0, 3.0]])).sum())
    kappa = found.model.bulk_modulus
    assert kappa is not None
    rows = [{"method": "network", "cpu_seconds": seconds, **constants(mu, kappa)}]
    law = replace(CLASSICAL[0], start=(mu, kappa))
    start = time.process_time()
    fit = classical_fit.fit(law, found, classical_fit.weights_made_anew(found))
    seconds = time.process_time() - start
    return [*rows, {"method": "two constants", "cpu_seconds": seconds, **constants(*fit.parameters)}]


def study(size_factors: tuple[float, ...], seeds: int) -> list[dict[str, Any]]:
    """Every mesh, noise and seed."""
    rows = []
    for size_factor in size_factors:
        mesh, u = solve(size_factor)
        for noise in NOISES:
            for seed in range(seeds if noise else 1):
                for row in identify(measured(mesh, u, noise, seed)):
                    rows.append({"points": len(mesh.points), "noise": noise, "seed": seed, **row})
    return rows
