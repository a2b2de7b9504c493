"""Blind trials: a seed in, the Experiment of a test with one hidden effect (or none, or two) and its sealed label out.

`draw` fixes every number of a trial, `make` solves and observes it, `write` puts the Experiment and, in a folder of its
own, the label on disk. The effects are implemented in `forward.effects` and `studies.disturbances`, as they are in the
laboratory; what the diagnosis takes them for (`calibrate.effects`) is not used here. Amplitudes in a label follow the
convention of that catalogue, so that fitted and true ones can be compared.

The Experiment says nothing of the effect: specimens, base materials, thicknesses, loads, times and noise are drawn from
the same ranges for all of them. Load cells read with an error of `force_relative` of the force and, so that the
transverse forces of a symmetric test are not exactly zero, of `force_floor` of the largest force.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from calibrate.experiment import Experiment, LoadedBoundary, Noise, signed_areas
from forward.loading import Loading
from forward.materials import ArrudaBoyce, Material, NeoHooke, Yeoh
from meshes import Cross, Mesh, PlateWithHole, Specimen, specimen_from_dict
from studies.blind_effects import EFFECTS, FREQUENT, SOLID, UNLOADING, Hidden, Situation, check, log_uniform
from studies.camera import GaussianField, stream
from studies.disturbances import (
    Disturbance,
    ForceGain,
    ForceOffset,
    Lag,
    LensDistortion,
    OutOfPlane,
    Rotation,
    Scale,
    SubsetSmoothing,
    UnmeasuredStrip,
    observe,
)
from studies.writing import write_json

if TYPE_CHECKING:
    from forward.effects import Sheet
    from forward.solution import SurfaceSolution

Array = NDArray[np.float64]
CROSS_SCALE = 0.25
SPECIMENS: dict[str, Specimen] = {
    "cross": Cross(**{name: CROSS_SCALE * value for name, value in Cross().dimensions().items()}),
    "plate": PlateWithHole(half_length=30, half_width=15, far_size=3, hole_radius=5, hole_size=0.8),
    "wide plate": PlateWithHole(half_length=25, half_width=20, far_size=3, hole_radius=8, hole_size=1.0),
}
SIZES = {  # of the quads at holes and far from them, mm: fine enough where grips and free edges meet
    "cross": {"hole_size": 0.36, "far_size": 1.8},
    "plate": {"hole_size": 0.7, "far_size": 1.1},
    "wide plate": {"hole_size": 0.7, "far_size": 1.1},
}
CAMERA_NODES = 1400
RAMP = tuple(k / 10 for k in range(1, 11))
HISTORIES = (
    (0.2, 0.4, 0.6, 0.4, 0.2, 0.4, 0.7, 1.0, 0.75, 0.5, 0.75, 1.0),
    (1 / 6, 2 / 6, 3 / 6, 4 / 6, 5 / 6, 1.0, 0.75, 0.5, 0.25, 0.5, 0.75, 1.0),
)
HISTORY_SHARE = 0.3  # of the trials whose effect does not ask for unloading
VISCOUS_SUBSTEPS = 3
FIELD_RESOLUTION = 512
WAVES = 4  # of the cosines that the catalogue describes a field with, in each direction
SOLID_LAYERS = 1  # of hexes in half the thickness
NOISE, REST = 0, 1  # random streams


@dataclass(frozen=True)
class Trial:
    """Every number of a trial. Lengths in mm, times in s.

    stretch: nominal, of the specimen; factors, times: load factor and time of each increment; displacement_std and
    correlation_length of the noise; force_relative: std of a force over its size; force_floor: over the largest.
    """

    seed: int
    specimen: str
    material: Material
    thickness: float
    stretch: float
    factors: tuple[float, ...]
    times: tuple[float, ...]
    effects: tuple[Hidden, ...]
    displacement_std: float
    correlation_length: float
    force_relative: float
    force_floor: float

    @property
    def displacement(self) -> float:
        """Of each grip at load factor 1, mm."""
        return (self.stretch - 1) * SPECIMENS[self.specimen].half_extent[0]


def draw(seed: int, effect: str | None = "random", second: str | None = None) -> Trial:
    """A trial. effect: a name in `EFFECTS`, None, or 'random' (of those that are no gauges); second: another one.

    Everything but the effects depends on `seed` alone as far as the effects allow. Raises `OptionError`.
    """
    rng = stream(seed, REST)
    random = FREQUENT[int(rng.integers(len(FREQUENT)))]
    names = [random if name == "random" else name for name in (effect, second) if name is not None]
    check(names)
    key = list(SPECIMENS)[int(rng.integers(len(SPECIMENS)))]
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
    force = material.shear_modulus * thickness * 2 * specimen.dimensions()["half_width"] * (stretch - stretch**-2)
    situation = Situation(extent, material.shear_modulus, duration, float(np.diff(times).min()), force)
    effects = tuple(Hidden(name, *EFFECTS[name](rng, situation)) for name in names)
    for hidden in effects:
        thickness = hidden.more.get("thickness", thickness)
    return Trial(seed, key, material, thickness, stretch, factors, times, effects, *noise, force_floor=0.2 * noise[2])


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


def shares(trial: Trial) -> Array:
    """Share (t,) of the largest load factor, which an out-of-plane motion follows."""
    return np.asarray(trial.factors) / max(trial.factors)


def clean_experiment(trial: Trial, size_factor: float = 1.0) -> Experiment:
    """The Experiment of a trial before noise. size_factor: of the quads."""
    mesh, specimen = camera_mesh(trial.specimen), SPECIMENS[trial.specimen]
    return observe(solve(trial, size_factor), specimen, mesh, disturbances(trial), shares(trial), f"blind {trial.seed}")


def record(trial: Trial, clean: Experiment) -> Experiment:
    """`clean` with the noise of camera and load cells."""
    rng = stream(trial.seed, NOISE)
    field = GaussianField(trial.correlation_length, FIELD_RESOLUTION)
    fields = np.array([field.sample(clean.points, rng) for _ in range(clean.n_increments)])
    largest = max(float(np.abs(b.force).max()) for b in clean.loaded)
    noise = Noise(trial.displacement_std, trial.correlation_length, trial.force_relative, trial.force_floor * largest)
    loaded = []
    for b in clean.loaded:
        relative, floor = rng.standard_normal((2, *b.force.shape))
        error = noise.force_std_relative * np.abs(b.force) * relative + noise.force_std * floor
        loaded.append(LoadedBoundary(b.name, b.nodes, b.force + error))
    specimen = SPECIMENS[trial.specimen].to_dict()
    return replace(
        clean,
        displacements=clean.displacements + trial.displacement_std * fields,
        loaded=tuple(loaded),
        noise=noise,
        provenance={"study": "blind trials", "specimen": specimen},
    )


@lru_cache(maxsize=8)
def camera_mesh(specimen: str) -> Mesh:
    """The fixed triangulation of a specimen."""
    from meshes import triangles

    return triangles(SPECIMENS[specimen], n_nodes=CAMERA_NODES)


@lru_cache(maxsize=16)
def forward_mesh(specimen: str, size_factor: float = 1.0, quarter: bool = False) -> Mesh:
    """The quads of a specimen."""
    from meshes import quads

    described = specimen_from_dict({**SPECIMENS[specimen].to_dict(), **SIZES[specimen]})
    return quads(described, quarter, size_factor)


def solve(trial: Trial, size_factor: float = 1.0) -> SurfaceSolution:
    """Exact surface displacements at the pictures and forces at the readings."""
    lag = next((d for d in disturbances(trial) if isinstance(d, Lag)), None)
    if any(hidden.name == SOLID for hidden in trial.effects):
        return _solve_solid(trial, size_factor, lag)
    from forward.inelastic import solve_history

    factors, times = (trial.factors, trial.times) if lag is None else lag.schedule(trial.factors, trial.times)
    described = sheet(trial)
    solution = solve_history(
        forward_mesh(trial.specimen, size_factor),
        described,
        Loading.clamped(SPECIMENS[trial.specimen].loaded, trial.displacement),
        factors,
        times,
        substeps=1 if described.prony is None else VISCOUS_SUBSTEPS,
    )
    return solution if lag is None else lag.split(solution, trial.times)


def _solve_solid(trial: Trial, size_factor: float, lag: Lag | None) -> SurfaceSolution:
    """The surface of a thick specimen, an eighth of which is solved; forces at the readings by a spline."""
    from forward.solid import Options
    from forward.solid import solve as solve_in_3d
    from meshes.solid import extrude

    sides = SPECIMENS[trial.specimen].loaded
    solution = solve_in_3d(
        extrude(forward_mesh(trial.specimen, size_factor, quarter=True), trial.thickness, SOLID_LAYERS),
        trial.material,
        Loading.clamped(sides, trial.displacement, dimension=3),
        len(trial.factors),
        options=Options(tolerance=1e-6, volume_tolerance=1e-6),
    )
    surface = replace(solution.surface().mirrored(), time=np.asarray(trial.times))
    if lag is None:
        return surface
    read = {
        side: CubicSpline([0.0, *trial.times], [np.zeros(2), *force])(surface.time + lag.dt)
        for side, force in surface.reactions.items()
    }
    return replace(surface, reactions=read)


def sheet(trial: Trial) -> Sheet:
    """The sheet with the effects that are in the material."""
    from forward import effects as laws

    additions: list[laws.Addition] = []
    changes: dict[str, Any] = {}
    for hidden in trial.effects:
        a, s, more = hidden.amplitudes, hidden.shape, hidden.more
        match hidden.name:
            case "second invariant":
                additions.append(laws.MooneyPart(a["c01"]))
            case "compressibility":
                changes["bulk_modulus"] = 1 / a["beta"]
            case "one fibre family":
                additions.append(laws.Fibres(a["k"], (s["angle"],)))
            case "two fibre families":
                additions.append(laws.Fibres(a["k"], (s["axis"] + s["half"], s["axis"] - s["half"])))
            case "stiffness gradient":
                length = 2 * max(SPECIMENS[trial.specimen].half_extent)
                additions.append(laws.Gradient(a["gx"], a["gy"], length))
            case "stiffness field":
                additions.append(laws.Patch(more["height"], more["x"], more["y"], more["width"]))
            case "viscoelasticity":
                changes["prony"] = laws.Prony(a["g"], s["tau"])
            case "Mullins softening":
                additions.append(laws.Mullins(a["r"]))
            case "Payne softening":
                additions.append(laws.Payne(a["r"], s["x0"]))
    return laws.Sheet(trial.material, trial.thickness, tuple(additions), **changes)


def disturbances(trial: Trial) -> list[Disturbance]:
    """The effects that are in the recording."""
    kinds: dict[str, type[Disturbance]] = {
        kind.name: kind
        for kind in (ForceOffset, ForceGain, Lag, Rotation, Scale, LensDistortion, OutOfPlane, UnmeasuredStrip)
    }
    found: list[Disturbance] = []
    for hidden in trial.effects:
        if hidden.name in kinds:
            found.append(kinds[hidden.name](**hidden.amplitudes))
        elif hidden.name == SubsetSmoothing.name:
            found.append(SubsetSmoothing(hidden.more["side"]))
    return found
