"""A folder as the thickness study leaves it, made up in a second: the plane-stress solution is real, all else is not.

The solid is the sheet with its own contraction, plus a known dent near the holes that grows with thickness; the models
are neo-Hookean with known errors of stiffness.
"""

from dataclasses import asdict

import numpy as np

from calibrate import pann
from calibrate.model import Model
from forward import ArrudaBoyce, Loading
from forward.interpolation import gauss_points
from forward.plane_stress import solve
from forward.solid_solution import SolidSolution
from meshes import Cross, quads
from meshes.solid import extrude
from studies.cases import score
from studies.epsilon import epsilon_field
from studies.output import write_json
from studies.stress_error import COMPONENTS, States
from studies.thickness_case import Settings

LIMIT = 3.3  # of I1; so near to rest the truth is almost neo-Hookean
STIFFNESS = {"plane": 0.0, "10": 0.002, "40": 0.03}  # error of the models' stiffness
DENT = 1e-3  # of the displacement at a rim, per mm of thickness


SETTINGS = Settings(nodes=400, seeds=(0, 1, 2), displacement=20.0, increments=3, thicknesses=(10.0, 40.0))


def neo_hooke(stiffness: float) -> Model:
    """psi = stiffness mu / 2 (I1 - 3) with the initial shear modulus mu of the truth."""
    mu = stiffness * ArrudaBoyce().shear_modulus
    return Model(pann.Architecture("I1", (1,)), np.array([0.0, 0.0, 0.0, mu / 2]))


def solid_of(plane, thickness, layers=2):
    """A made-up solid above a sheet: u (1 + dent), contracting by 1 / det F at each node."""
    mesh = extrude(plane.mesh, thickness, layers)
    n, levels = len(plane.points), mesh.levels
    ratio = np.ones((len(plane.time), n))
    slopes, _, _ = gauss_points(plane.mesh)
    gradients = np.eye(2) + np.einsum("mqnj,tmni->tmqij", slopes, plane.displacements[:, plane.cells])
    ratio[:, plane.cells.ravel()] = np.repeat(1 / np.linalg.det(gradients).mean(axis=2), 9, axis=1)
    distance = np.min([hole.level(plane.points) - 1 for hole in Cross().holes()], axis=0)
    dent = 1 + DENT * thickness * np.exp(-2 * distance)
    sheet = plane.displacements * dent[:, None]
    u = np.concatenate([np.concatenate([sheet, (z * (ratio - 1))[..., None]], axis=-1) for z in levels], axis=1)
    centres = mesh.points[mesh.cells].mean(axis=1)
    pressure = np.zeros((len(plane.time), len(mesh.cells), 4))
    pressure[..., 0] = plane.time[:, None] * np.cos(centres[:, 0] / 30)
    reactions = {
        side: np.concatenate([thickness * 1.01 * force, np.zeros((len(force), 1))], axis=1)
        for side, force in plane.reactions.items()
    }
    return SolidSolution(
        mesh, u, pressure, reactions, plane.time, thickness * plane.energy / 2, plane.iterations, 1e4, {}
    )


def fill(folder, settings=SETTINGS):
    """Write the folder; returns it."""

    mesh = quads(Cross(), quarter=True, size_factor=4)
    plane = solve(mesh, ArrudaBoyce(), Loading.clamped(Cross().loaded, settings.displacement), settings.increments)
    plane.save(folder / "plane.npz")
    for h in settings.thicknesses:
        solid = solid_of(plane, h)
        solid.save(folder / f"solid_{h:g}.npz")
        epsilon_field(plane, solid).save(folder / f"epsilon_{h:g}.npz")
    States.of(plane).save(folder / "states.npz")
    (folder / "cases").mkdir()
    for condition in ("plane", *(f"{h:g}" for h in settings.thicknesses)):
        for seed in ("clean", *map(str, settings.seeds)):
            write_json(folder / "cases" / f"{condition}_{seed}.json", case(condition, seed))
    write_json(folder / "run.json", {"settings": {"study": "thickness", **asdict(settings)}})
    return folder


def case(condition, seed):
    """One case: the default loss has the known stiffness error, the paper's one fails."""
    shift = 0.0 if seed == "clean" else 0.004 * (int(seed) - 1)
    losses = {}
    for loss, error in (("weighted", STIFFNESS[condition] + shift), ("paper-frozen", -0.9)):
        model = neo_hooke(1 + error)
        percent = 100 * error
        spread = 1.0 + 20 * STIFFNESS[condition]
        stress = {"median": percent, "mean": percent, "p05": percent - spread, "p25": percent, "p75": percent,
                  "p95": percent + spread}  # fmt: skip
        losses[loss] = {
            **score(model, LIMIT), "model": model.to_dict(), "seconds": 1.0,
            "stress_error": dict.fromkeys(COMPONENTS, stress), "stiffness_error": stress,
            "energy_error": {"median_abs": abs(percent), "p95_abs": 2 * abs(percent), "mean": percent},
        }  # fmt: skip
    return {"condition": condition, "thickness": 1.0 if condition == "plane" else float(condition), "seed": seed,
            "nodes": 400, "triangles": 700, "calibrated_I1": LIMIT, "losses": losses}  # fmt: skip
