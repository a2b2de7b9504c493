r"""The camera and the load cell: an exact solution in, the Experiment that they would have recorded out.

Displacements: u + eta dx g, with g a Gaussian random field for each component and increment, independent of the
others, of zero mean, unit variance and covariance

    C(r) = exp(-r^2 / (2 l^2)),                                          l: correlation length

so that eta dx (5e-4 x 200 mm = 0.1 mm) is the standard deviation of the noise. The other reading of "normalised",
max |g| = 1 over the grid, is ``normalisation="unit-maximum"``; the standard deviation is then about four times
smaller. g is made by the FFT on a regular square grid around the specimen and interpolated bilinearly to the
nodes. Every node gets noise, those on the boundary as well.

Two more such fields may be common to all increments (`Noise`): errors that stay with the speckle pattern, times the share of the deformation of each
increment, and errors of the reference picture.

Forces: each reading times a factor from U[1 - 1e-4, 1 + 1e-4], the same for opposite sides; where the solution has readings between its
increments, they and the increments are the machine record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment, LoadedBoundary, Noise
from calibrate.errors import ConfigError, MeshMismatchError
from meshes import Mesh
from studies.synthetic.simulated_record import as_read, simulated_record

Array = NDArray[np.float64]
NORMALISATIONS = ("unit-variance", "unit-maximum")
AXIS = {"left": "x", "right": "x", "bottom": "y", "top": "y"}
PADDING = 6.0  # correlation lengths between opposite sides of the specimen, around the periodic grid
NEGLIGIBLE = 1e-7  # relative amplitude of the waves that are left out
DISPLACEMENTS, FORCES, PATTERN, REFERENCE = 0, 1, 2, 3  # random streams


class Solution(Protocol):
    """What the camera needs from a forward solution of the whole specimen.

    reactions: {boundary: (n_increments, 2)}, force of the grip on the specimen, N; thickness mm; time (n_increments,);
    description: free, 'plane' in it is 'strain' or, where it is absent, 'stress'.
    """

    @property
    def reactions(self) -> dict[str, Array]: ...

    @property
    def description(self) -> dict[str, Any]: ...

    @property
    def thickness(self) -> float: ...

    @property
    def time(self) -> Array: ...

    def evaluate(self, points: Array) -> Array:
        """Displacements (n_increments, n, 2), mm, at points (n, 2), mm."""
        ...


@dataclass(frozen=True)
class GaussianField:
    """Gaussian random field with covariance exp(-r^2 / (2 l^2)) on a periodic grid that encloses the points.

    correlation_length: l, mm. resolution: grid points a side. normalisation: 'unit-variance' (of the ensemble) or
    'unit-maximum' (max |g| = 1 of each field on the grid). Raises `ConfigError`.
    """

    correlation_length: float = 4.0
    resolution: int = 2048
    normalisation: str = "unit-variance"

    def __post_init__(self) -> None:
        if self.normalisation not in NORMALISATIONS:
            raise ConfigError(
                f"normalisation '{self.normalisation}' unknown; choose one of {', '.join(NORMALISATIONS)}"
            )
        if not (np.isfinite(self.correlation_length) and self.correlation_length > 0):
            raise ConfigError(f"correlation length {self.correlation_length} mm: give a positive length")
        if self.resolution < 8:
            raise ConfigError(f"a grid of {self.resolution} points a side is too coarse for a random field; give 2048")

    def grid(self, points: Array) -> tuple[Array, float]:
        """Origin (2,) and side, mm, of the square periodic grid around points (n, 2)."""
        low, high = points.min(axis=0), points.max(axis=0)
        side = float((high - low).max()) + PADDING * self.correlation_length
        return 0.5 * (low + high) - 0.5 * side, side

    def on_grid(self, side: float, rng: np.random.Generator) -> NDArray[np.complex128]:
        """Two independent fields (resolution, resolution), the real and the imaginary part; the axes are x, y.

        side: of the grid, mm. Raises `ConfigError` where the grid is too coarse for the correlation length.
        """
        waves, amplitude = _spectrum(self.correlation_length, side)
        if 2 * waves.max() >= self.resolution:
            raise ConfigError(
                f"a grid of {self.resolution} points on {side:.0f} mm cannot carry a correlation length of "
                f"{self.correlation_length} mm; it needs more than {2 * waves.max()}"
            )
        white = rng.standard_normal((2, waves.size, waves.size))
        columns = np.zeros((self.resolution, waves.size), complex)
        columns[waves] = amplitude * (white[0] + 1j * white[1])
        spectrum = np.zeros((self.resolution, self.resolution), complex)
        spectrum[:, waves] = scipy.fft.ifft(columns, axis=0, norm="forward")
        fields = scipy.fft.ifft(spectrum, axis=1, norm="forward", overwrite_x=True)
        if self.normalisation == "unit-maximum":
            fields.real /= np.abs(fields.real).max()
            fields.imag /= np.abs(fields.imag).max()
        return fields

    def sample(self, points: Array, rng: np.random.Generator) -> Array:
        """Two independent fields (n, 2) at points (n, 2), mm. Raises `ConfigError`, see `on_grid`."""
        origin, side = self.grid(points)
        values = interpolate(self.on_grid(side, rng), (points - origin) * (self.resolution / side))
        return np.stack([values.real, values.imag], axis=1)


@lru_cache(maxsize=8)
def _spectrum(length: float, side: float) -> tuple[NDArray[np.int64], Array]:
    """Wave numbers (k,) kept along each axis and amplitudes (k, k), sum of squares 1: spectrum exp(-k^2 l^2 / 2)."""
    largest = int(np.ceil(np.sqrt(-4 * np.log(NEGLIGIBLE)) * side / (2 * np.pi * length)))
    waves = np.arange(-largest, largest + 1)
    one = np.exp(-0.25 * (2 * np.pi * length / side * waves) ** 2)
    one /= np.linalg.norm(one)
    return waves, np.outer(one, one)


def interpolate(values: NDArray, position: Array) -> NDArray:
    """Bilinear interpolation of periodic grid values (k, k) at positions (n, 2) in grid units."""
    cell = np.floor(position).astype(np.int64)
    s, t = (position - cell).T
    (i, j), (i1, j1) = (cell % len(values)).T, ((cell + 1) % len(values)).T
    return (1 - t) * ((1 - s) * values[i, j] + s * values[i1, j]) + t * ((1 - s) * values[i, j1] + s * values[i1, j1])


@dataclass(frozen=True)
class Camera:
    """Camera and load cell. Displacement noise is relative_noise (eta) x length_scale (dx, mm) x `field`;

    force_noise: half width of the uniform factor on forces. pattern_noise, reference_noise: like relative_noise, of what all increments share.
    Raises `ConfigError`.
    """

    field: GaussianField = field(default_factory=GaussianField)
    relative_noise: float = 5e-4
    length_scale: float = 200.0
    force_noise: float = 1e-4
    pattern_noise: float = 0.0
    reference_noise: float = 0.0

    def __post_init__(self) -> None:
        for key in ("relative_noise", "length_scale", "force_noise", "pattern_noise", "reference_noise"):
            if not (np.isfinite(getattr(self, key)) and getattr(self, key) >= 0):
                raise ConfigError(f"camera: {key} = {getattr(self, key)} must be a finite number >= 0")

    @property
    def amplitude(self) -> float:
        """eta dx, mm."""
        return self.relative_noise * self.length_scale

    def displacement_noise(self, points: Array, n_increments: int, seed: int) -> Array:
        """Noise (n_increments, n, 2), mm, at points (n, 2), mm; increment k depends on `seed` and k alone."""
        fields = [self.field.sample(points, stream(seed, DISPLACEMENTS, k)) for k in range(n_increments)]
        return self.amplitude * np.array(fields)

    def common_noise(self, points: Array, shares: Array, seed: int) -> Array:
        """What increments with shares of the deformation (t,) have in common (t, n, 2), mm, at points (n, 2), mm."""
        result = np.zeros((len(shares), *points.shape))
        for level, key, factors in (
            (self.pattern_noise, PATTERN, shares),
            (self.reference_noise, REFERENCE, np.ones(len(shares))),
        ):
            if level > 0:
                field = level * self.length_scale * self.field.sample(points, stream(seed, key))
                result += factors[:, None, None] * field
        return result

    def force_factors(self, names: Sequence[str], count: int, seed: int, key: int = FORCES) -> dict[str, Array]:
        """Factors {boundary: (count,)} of readings: one for left and right, one for bottom and top, one for each other."""
        groups = ["x", "y", *sorted({name for name in names if name not in AXIS})]
        draws = np.array([stream(seed, key, k).uniform(-1, 1, len(groups)) for k in range(count)])
        factors = 1 + self.force_noise * draws
        return {name: factors[:, groups.index(AXIS.get(name, name))] for name in names}

    def noise(self, displacement_std: float | None = None) -> Noise:
        """The noise as an Experiment states it; `displacement_std`, mm, replaces eta dx."""
        common = self.length_scale * self.pattern_noise, self.length_scale * self.reference_noise
        whole = Noise(self.amplitude, self.field.correlation_length, float(self.force_noise / np.sqrt(3)), 0.0, *common)
        return (
            whole if displacement_std is None or not self.amplitude else whole.scaled(displacement_std / self.amplitude)
        )

    def to_dict(self) -> dict[str, Any]:
        """Settings with the covariance and the amplitude in mm, for a manifest."""
        return {
            **asdict(self),
            "covariance": "exp(-r^2 / (2 l^2))",
            "displacement_amplitude_mm": self.amplitude,
        }


def stream(seed: int, *key: int) -> np.random.Generator:
    """Random numbers that depend on `seed` and `key` alone, not on what was drawn before."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def record(experiment: Experiment, camera: Camera, seed: int) -> Experiment:
    """The clean `experiment` as `camera` and load cell record it.

    Raises `ExperimentError` when the noise folds triangles over.
    """
    noise = camera.displacement_noise(experiment.points, experiment.n_increments, seed)
    factors = camera.force_factors([b.name for b in experiment.loaded], experiment.n_increments, seed)
    loaded = [replace(b, force=b.force * factors[b.name][:, None]) for b in experiment.loaded]
    read = experiment.record
    if read is not None and experiment.time is not None:
        read = as_read(read, experiment.time, [b.name for b in experiment.loaded], camera, seed)
    common = camera.common_noise(experiment.points, experiment.deformation_shares, seed)
    unit_maximum = camera.field.normalisation == "unit-maximum"
    return replace(
        experiment,
        name=f"{experiment.name}, noise seed {seed}",
        displacements=experiment.as_seen(experiment.displacements + noise + common),
        loaded=tuple(loaded),
        record=read,
        noise=camera.noise(float(noise.std()) if unit_maximum else None),
        provenance={**experiment.provenance, "camera": camera.to_dict(), "noise_seed": seed},
    )


def boundaries(mesh: Mesh, forces: dict[str, Array]) -> tuple[tuple[LoadedBoundary, ...], NDArray[np.int64]]:
    """Loaded boundaries and free nodes of a triangle mesh; corner nodes between both are loaded.

    forces: {boundary: (n_increments, 2)}, N. Raises `MeshDataError` for a boundary that the mesh does not have.
    """
    loaded = tuple(LoadedBoundary(name, mesh.boundary_nodes(name), force) for name, force in forces.items())
    held = np.concatenate([b.nodes for b in loaded])
    return loaded, np.setdiff1d(mesh.boundary_nodes("free"), held)


def observe(
    solution: Solution,
    mesh: Mesh,
    camera: Camera | None = None,
    seed: int | None = None,
    name: str = "synthetic",
    provenance: dict[str, Any] | None = None,
) -> Experiment:
    """The Experiment that a camera with its points on the nodes of `mesh` (triangles, whole specimen) records.

    seed: of the noise; None = the clean fields. camera: None = the default one.
    Raises `MeshMismatchError` when the mesh has no triangles or lacks a boundary of the solution, and
    the errors of an Experiment and of `record`.
    """
    if mesh.cell_type != "triangle":
        raise MeshMismatchError(f"the camera needs a mesh of triangles, not of {mesh.cell_type}s")
    missing = set(solution.reactions) - set(mesh.boundaries)
    if missing:
        raise MeshMismatchError(f"the mesh has no boundary '{min(missing)}', on which the solution has a force")
    loaded, free = boundaries(mesh, solution.reactions)
    clean = Experiment(
        name=name,
        points=mesh.points,
        triangles=mesh.cells,
        displacements=solution.evaluate(mesh.points),
        loaded=loaded,
        free_nodes=free,
        thickness=solution.thickness,
        time=solution.time,
        provenance=provenance or {},
        plane=str(solution.description.get("plane", "stress")),
        record=simulated_record(solution),
    )
    return clean if seed is None else record(clean, camera or Camera(), seed)
