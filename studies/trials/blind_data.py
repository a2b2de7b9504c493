"""Blind trials: a seed in, the Experiment of a test with one hidden effect (or none, or two) and its sealed label out.

`draw` fixes every number of a trial, `make` solves and observes it, `write` puts the Experiment and, in a folder of its
own, the label on disk. The effects are implemented in `forward.sheet.additions` and `studies.synthetic.disturbances`, as they are in the
laboratory; what the diagnosis takes them for (`calibrate.effects`) is not used here, but for conventions of parameters. Amplitudes in a label follow the
convention of that catalogue, so that fitted and true ones can be compared.

The Experiment says nothing of the effect: specimens, base materials, thicknesses, loads, times and noise are drawn from
the same ranges for all of them. Load cells read with an error of `force_relative` of the force and, so that the
transverse forces of a symmetric test are not exactly zero, of `force_floor` of the largest force.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment, Noise
from calibrate.data.triangulation import signed_areas
from forward.materials import ArrudaBoyce, Material, NeoHooke, Yeoh
from meshes import Mesh, Specimen
from studies.output.writing import write_json
from studies.synthetic.camera import GaussianField, stream
from studies.trials.blind_effects import (
    BIAXIAL,
    EFFECTS,
    FREQUENT,
    SOLID,
    UNLOADING,
    Hidden,
    Situation,
    check,
    log_uniform,
)
from studies.trials.blind_solution import camera_mesh, clean_experiment, warp
from studies.trials.blind_trial import FIELD_RESOLUTION, SPECIMENS, Trial
from studies.trials.foreign import noise_of

Array = NDArray[np.float64]
RAMP = tuple(k / 10 for k in range(1, 11))
HISTORIES = (
    (0.2, 0.4, 0.6, 0.4, 0.2, 0.4, 0.7, 1.0, 0.75, 0.5, 0.75, 1.0),
    (1 / 6, 2 / 6, 3 / 6, 4 / 6, 5 / 6, 1.0, 0.75, 0.5, 0.25, 0.5, 0.75, 1.0),
)
HISTORY_SHARE = 0.3  # of the trials whose effect does not ask for unloading
WAVES = 4  # of the cosines that the catalogue describes a field with, in each direction
STRAINS = 5  # Legendre polynomials of the strain of a warp, in each direction
NOISE, REST = 0, 1  # random streams


def draw(seed: int, effect: str | None = "random", second: str | None = None) -> Trial:
    """A trial. effect: a name in `EFFECTS`, None, or 'random' (of those that are not confounded); second: another one.

    Everything but the effects depends on `seed` alone as far as the effects allow. Raises `OptionError`.
    """
    rng = stream(seed, REST)
    random = FREQUENT[int(rng.integers(len(FREQUENT)))]
    names = [random if name == "random" else name for name in (effect, second) if name is not None]
    check(names)
    key = list(SPECIMENS)[int(rng.integers(len(SPECIMENS)))]
    if BIAXIAL in names:
        key = "cross"
    specimen, material = SPECIMENS[key], _material(rng)
    extent = 2 * max(specimen.half_extent)
    thickness = float(rng.uniform(1, 6))
    stretch = float(rng.uniform(1.2, 1.6))
    factors, cycles = RAMP, HISTORIES[int(rng.integers(len(HISTORIES)))]
    if (rng.uniform() < HISTORY_SHARE or set(names) & set(UNLOADING)) and SOLID not in names:
        factors = cycles
    duration = log_uniform(rng, 1, 60)
    path = np.cumsum(np.abs(np.diff(factors, prepend=0.0)))
    times = tuple(float(t) for t in duration * path / path[-1])
    noise = (
        extent * log_uniform(rng, 2e-5, 2e-4),
        extent * float(rng.uniform(0.015, 0.03)),
        log_uniform(rng, 1e-4, 1e-3),
    )
    about = situation(specimen, material, thickness, stretch, duration, float(np.diff(times).min()))
    effects = tuple(Hidden(name, *EFFECTS[name](rng, about)) for name in names)
    for hidden in effects:
        thickness = hidden.more.get("thickness", thickness)
    return Trial(seed, key, material, thickness, stretch, factors, times, effects, *noise, force_floor=0.2 * noise[2])


def situation(
    specimen: Specimen, material: Material, thickness: float, stretch: float, duration: float, interval: float
) -> Situation:
    """What sizes of effects depend on, of a test with these numbers; see `Trial`. duration, and the shortest interval, s."""
    force = material.shear_modulus * thickness * 2 * specimen.dimensions()["half_width"] * (stretch - stretch**-2)
    return Situation(2 * max(specimen.half_extent), material.shear_modulus, duration, interval, force)


def _material(rng: np.random.Generator) -> Material:
    """A material of the first invariant alone, that stiffens or not."""
    kind, mu, shape = int(rng.integers(3)), log_uniform(rng, 0.1, 1.0), rng.uniform(0, 1, 2)
    if kind == 0:
        return ArrudaBoyce(mu, 6 + 24 * float(shape[0]))
    if kind == 1:
        return NeoHooke(mu)
    return Yeoh(mu / 2, -0.01 * mu * float(shape[0]), mu * (5e-4 + 2e-3 * float(shape[1])))


def make(trial: Trial) -> tuple[Experiment, dict[str, Any]]:
    """The Experiment of a trial and its label as plain data. Raises the errors of the forward models."""
    return record(trial, clean_experiment(trial)), label(trial)


def write(trial: Trial, folder: str | Path) -> None:
    """Write ``experiment.npz``, and ``sealed/label.json`` with what is hidden."""
    experiment, sealed = make(trial)
    experiment.save(Path(folder) / "experiment.npz")
    write_json(Path(folder) / "sealed" / "label.json", sealed)


def label(trial: Trial) -> dict[str, Any]:
    """What is hidden, and every number of the trial."""
    effects = [asdict(hidden) for hidden in trial.effects]
    for content in effects:
        if content["name"] == "stiffness field":
            content["amplitudes"] = waves(camera_mesh(trial.specimen), content["more"])
        elif content["name"] == "initial warp":
            content["amplitudes"] = strains(camera_mesh(trial.specimen), content["more"])
    return {**asdict(trial), "material": trial.material.to_dict(), "effects": effects}


def waves(mesh: Mesh, patch: dict[str, float]) -> dict[str, float]:
    """The catalogue's cosines a_kl closest in L2 to the stiffness s(x) of a patch, relative to their constant part."""
    centroids = mesh.points[mesh.cells].mean(axis=1)
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    x = np.pi * (centroids - low) / (high - low)
    basis = [np.cos(k * x[:, 0]) * np.cos(l * x[:, 1]) for k in range(WAVES) for l in range(WAVES)]
    r2 = ((centroids - [patch["x"], patch["y"]]) ** 2).sum(axis=1)
    s = 1 + patch["height"] * np.exp(-r2 / (2 * patch["width"] ** 2))
    root = np.sqrt(signed_areas(mesh.points, mesh.cells))
    a = np.linalg.lstsq(root[:, None] * np.array(basis).T, root * s, rcond=None)[0]
    return {f"a{i // WAVES}{i % WAVES}": float(a[i] / a[0]) for i in range(1, WAVES**2)}


def strains(mesh: Mesh, more: dict[str, float]) -> dict[str, float]:
    """The catalogue's coefficients: strain that a bent specimen regains, theta^2 / 2, in Legendre polynomials of x and y."""
    size = np.ptp(mesh.points, axis=0)
    xi, weights = np.polynomial.legendre.leggauss(60)
    angle = warp(more).inclination(0.5 * size[int(more["axis"])] * xi)
    result = {f"{letter}{k}": 0.0 for letter in "ab" for k in range(STRAINS)}
    for k in range(STRAINS):
        p = np.polynomial.legendre.Legendre.basis(k)(xi)
        result["ab"[int(more["axis"])] + str(k)] = float((2 * k + 1) / 2 * (weights * p * angle**2 / 2).sum())
    return result


def record(trial: Trial, clean: Experiment) -> Experiment:
    """`clean` with the noise of camera and load cells."""
    rng = stream(trial.seed, NOISE)
    largest = max(float(np.abs(b.force).max()) for b in clean.loaded)
    noise = Noise(trial.displacement_std, trial.correlation_length, trial.force_relative, trial.force_floor * largest)
    stated: Noise | None = noise
    if trial.foreign is None:
        field = GaussianField(trial.correlation_length, FIELD_RESOLUTION)
        errors = trial.displacement_std * np.array([field.sample(clean.points, rng) for _ in range(clean.n_increments)])
    else:
        errors, stated = noise_of(trial, clean, noise)
    loaded = []
    for b in clean.loaded:
        relative, floor = rng.standard_normal((2, *b.force.shape))
        error = noise.force_std_relative * np.abs(b.force) * relative + noise.force_std * floor
        loaded.append(replace(b, force=b.force + error))
    specimen = SPECIMENS[trial.specimen].to_dict()
    return replace(
        clean,
        displacements=clean.displacements + errors,
        loaded=tuple(loaded),
        noise=stated,
        provenance={"study": "blind trials", "specimen": specimen},
    )
