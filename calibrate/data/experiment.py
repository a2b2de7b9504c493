"""The Experiment: a measured or simulated surface test, the only thing that joins forward and calibrate.

In: reference points, triangles, displacements, loads (arrays, or one ``.npz`` of format version 1).
Out: a checked, immutable record; every violation is a named error that says where and what to do.

The ``.npz`` holds plain arrays (no pickles): ``format`` = "equigap-experiment", ``version`` = 1, ``name``,
``points``, ``triangles``, ``displacements``, ``free_nodes``, ``time`` and ``thickness`` (absent = unknown),
``loaded_names`` and per loaded boundary ``i``: ``loaded_i_nodes``, ``loaded_i_force``; ``noise`` (4 numbers:
displacement std mm, correlation length mm, relative force std, force std N; absent = unknown);
``provenance`` (JSON text). In plane strain ``plane`` = "strain", and ``version`` = 2, which older programs refuse.
"""

from __future__ import annotations

import io
import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.data.files import write_atomically
from calibrate.data.triangulation import boundary_nodes, signed_areas

FORMAT, VERSION, WITH_PLANE = "equigap-experiment", 1, 2
PLANES = ("stress", "strain")
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the measurement noise.

    displacement_std: per component and increment, mm.
    correlation_length: l in covariance std^2 exp(-r^2 / (2 l^2)), mm; 0 = uncorrelated between points.
    force_std_relative: standard deviation of a force relative to its magnitude.
    force_std: standard deviation of a force that does not scale with it, N.

    Raises `ExperimentError` for what is negative or not finite.
    """

    displacement_std: float
    correlation_length: float = 0.0
    force_std_relative: float = 0.0
    force_std: float = 0.0

    def __post_init__(self) -> None:
        for key, value in self.__dict__.items():
            if not np.isfinite(value) or value < 0:
                raise errors.ExperimentError(f"noise: {key} = {value} must be a finite number >= 0")


@dataclass(frozen=True)
class LoadedBoundary:
    """A gripped edge: its nodes (k,) and the force of the grip ON the specimen (n_increments, 2), N.

    A component that was not measured is NaN.
    """

    name: str
    nodes: NDArray[np.int64]
    force: Array


@dataclass(frozen=True)
class Experiment:
    """A surface test. Lengths in mm, forces in N, time in s, y upwards.

    points (n_nodes, 2): reference positions. triangles (n_triangles, 3), counter-clockwise.
    displacements (n_increments, n_nodes, 2). loaded: gripped boundaries with their measured forces.
    free_nodes: nodes on truly traction-free edges; other boundary nodes are the rim of the measured region.
    thickness: None = unknown; then stiffness times thickness (N/mm) is identified instead of MPa.
    time (n_increments,), from the start of loading: None = unknown. noise: None = unknown.
    plane: 'stress' of an incompressible sheet with free faces, or 'strain' of a compressible body held at its faces.

    Raises `ExperimentError` or a subclass of it when a check fails, `ConfigError` for another plane.
    """

    name: str
    points: Array
    triangles: NDArray[np.int64]
    displacements: Array
    loaded: tuple[LoadedBoundary, ...]
    free_nodes: NDArray[np.int64]
    thickness: float | None = None
    time: Array | None = None
    noise: Noise | None = None
    provenance: dict[str, Any] = field(default_factory=dict)
    plane: str = "stress"

    def __post_init__(self) -> None:
        for key in ("points", "displacements"):
            object.__setattr__(self, key, np.ascontiguousarray(getattr(self, key), dtype=np.float64))
        for key in ("triangles", "free_nodes"):
            object.__setattr__(self, key, np.ascontiguousarray(getattr(self, key), dtype=np.int64))
        if self.time is not None:
            object.__setattr__(self, "time", np.asarray(self.time, dtype=np.float64))
        loaded = tuple(
            LoadedBoundary(b.name, np.asarray(b.nodes, np.int64), np.asarray(b.force, np.float64)) for b in self.loaded
        )
        object.__setattr__(self, "loaded", loaded)
        check(self)

    @property
    def n_increments(self) -> int:
        """Number of increments."""
        return self.displacements.shape[0]

    @property
    def stress_unit(self) -> str:
        """MPa, or N/mm (stress times thickness) where the thickness is unknown."""
        return "N/mm" if self.thickness is None else "MPa"

    @property
    def force_imbalance(self) -> tuple[float, float] | None:
        """Norm of the sum of all forces over that of the largest, over all increments, and what noise explains of it.

        None where a force was not measured, or where part of the rim may carry one.
        """
        forces = np.array([b.force for b in self.loaded])
        held = np.concatenate([self.free_nodes, *(b.nodes for b in self.loaded)])
        if len(forces) < 2 or not np.isfinite(forces).all() or not np.isin(boundary_nodes(self.triangles), held).all():
            return None
        size = float(np.linalg.norm(np.linalg.norm(forces, axis=2).max(axis=0)))
        noise = self.noise or Noise(0.0)
        spread = float(np.linalg.norm(noise.force_std_relative * np.abs(forces) + noise.force_std))
        return (float(np.linalg.norm(forces.sum(axis=0))) / size, spread / size) if size > 0 else None

    def select(self, increments: NDArray[np.int64] | list[int], name: str | None = None) -> Experiment:
        """The same experiment with only the given increments (k,), counted from 0."""
        index = np.asarray(increments)
        return replace(
            self,
            name=name or self.name,
            displacements=self.displacements[index],
            time=None if self.time is None else self.time[index],
            loaded=tuple(LoadedBoundary(b.name, b.nodes, b.force[index]) for b in self.loaded),
        )

    def save(self, path: str | Path) -> None:
        """Write the documented ``.npz`` atomically."""
        arrays: dict[str, Any] = {
            "format": FORMAT,
            "version": VERSION if self.plane == "stress" else WITH_PLANE,
            "name": self.name,
            "points": self.points,
            "triangles": self.triangles,
            "displacements": self.displacements,
            "free_nodes": self.free_nodes,
            "loaded_names": np.array([b.name for b in self.loaded], dtype=np.str_),
            "provenance": json.dumps(self.provenance, sort_keys=True),
        }
        for i, boundary in enumerate(self.loaded):
            arrays[f"loaded_{i}_nodes"] = boundary.nodes
            arrays[f"loaded_{i}_force"] = boundary.force
        if self.time is not None:
            arrays["time"] = self.time
        if self.thickness is not None:
            arrays["thickness"] = self.thickness
        if self.plane != "stress":
            arrays["plane"] = self.plane
        if self.noise is not None:
            arrays["noise"] = np.array(list(self.noise.__dict__.values()))
        buffer = io.BytesIO()
        np.savez_compressed(buffer, allow_pickle=False, **arrays)
        write_atomically(path, buffer.getvalue())

    @classmethod
    def load(cls, path: str | Path) -> Experiment:
        """Read a ``.npz`` written by `save`.

        Raises `DataNotFoundError` when there is none, `FileFormatError` when it is no such file, `ExperimentError`
        or `ConfigError` when its content fails a check.
        """
        path = Path(path)
        if not path.exists():
            raise errors.DataNotFoundError(f"{path}: no such file; give the path of an Experiment .npz")
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
                content = {key: data[key] for key in data.files}
        except Exception as error:
            reason = "" if "pickle" in str(error) else f" ({error})"
            raise errors.FileFormatError(
                f"{path}: not a readable Experiment .npz{reason}; write it with `equigap import`"
            ) from error
        if str(content.get("format")) != FORMAT:
            raise errors.FileFormatError(
                f"{path}: an .npz, but not an Experiment (its 'format' is {content.get('format')}); "
                "raw measurements are read with `equigap import`"
            )
        if str(content.get("version")) not in (str(VERSION), str(WITH_PLANE)):
            raise errors.FileFormatError(
                f"{path}: Experiment version {content.get('version')}, this program reads {VERSION} and {WITH_PLANE}; "
                "update equigap"
            )
        try:
            loaded = tuple(
                LoadedBoundary(str(name), content[f"loaded_{i}_nodes"], content[f"loaded_{i}_force"])
                for i, name in enumerate(content["loaded_names"])
            )
            return cls(
                name=str(content["name"]),
                points=content["points"],
                triangles=content["triangles"],
                displacements=content["displacements"],
                loaded=loaded,
                free_nodes=content["free_nodes"],
                thickness=float(content["thickness"]) if "thickness" in content else None,
                time=content.get("time"),
                noise=Noise(*map(float, content["noise"])) if "noise" in content else None,
                provenance=json.loads(str(content["provenance"])),
                plane=str(content.get("plane", "stress")),
            )
        except KeyError as error:
            raise errors.FileFormatError(f"{path}: array {error} is missing; write the file again") from error
        except errors.EquigapError as error:
            raise type(error)(f"{path}: {error}") from error
        except (ValueError, TypeError) as error:
            raise errors.FileFormatError(f"{path}: an array is garbled ({error}); write the file again") from error


def check(experiment: Experiment) -> None:
    """Run every check on an Experiment; raises the named error of the first that fails."""
    _check_shapes(experiment)
    _check_mesh(experiment)
    _check_loads(experiment)
    _check_units(experiment)
    _check_deformation(experiment)


def _first(mask: NDArray[np.bool_]) -> str:
    """'3 (first: 17)' for the true entries of `mask`."""
    return f"{int(mask.sum())} (first: {int(np.flatnonzero(mask)[0])})"


def _check_shapes(e: Experiment) -> None:
    if e.plane not in PLANES:
        raise errors.ConfigError(f"plane '{e.plane}' unknown; choose one of {', '.join(PLANES)}")
    n = e.points.shape[0]
    if e.points.ndim != 2 or e.points.shape[1] != 2 or e.triangles.ndim != 2 or e.triangles.shape[1] != 3:
        raise errors.MeshMismatchError(
            f"points must be (n, 2) and triangles (m, 3), not {e.points.shape} and {e.triangles.shape}"
        )
    if e.displacements.ndim != 3 or e.displacements.shape[1:] != (n, 2):
        raise errors.MeshMismatchError(
            f"displacements {e.displacements.shape} do not match {n} nodes; expected (n_increments, {n}, 2): "
            "were mesh and displacements exported from the same analysis?"
        )
    if e.n_increments == 0 or len(e.triangles) == 0:
        raise errors.MeshMismatchError("an Experiment needs at least one increment and one triangle")
    nodes = [("triangles", e.triangles), ("free_nodes", e.free_nodes)]
    nodes += [(f"nodes of '{b.name}'", b.nodes) for b in e.loaded]
    for what, index in nodes:
        if index.size and (index.min() < 0 or index.max() >= n):
            raise errors.MeshMismatchError(
                f"{what}: node numbers run from {index.min()} to {index.max()}, but there are {n} nodes (count from 0)"
            )
    for b in e.loaded:
        if b.force.shape != (e.n_increments, 2):
            raise errors.MeshMismatchError(
                f"force of '{b.name}' has shape {b.force.shape}, expected ({e.n_increments}, 2): one row an increment"
            )
    if e.time is not None:
        if e.time.shape != (e.n_increments,):
            raise errors.MeshMismatchError(f"time has shape {e.time.shape}, expected ({e.n_increments},)")
        backwards = ~(np.diff(e.time) > 0)
        if backwards.any() or not np.isfinite(e.time).all():
            where = int(np.flatnonzero(backwards)[0]) + 1 if backwards.any() else -1
            raise errors.TimeError(f"time does not increase at increment {where}; sort or drop repeated frames")
        if e.time[0] < 0:
            raise errors.TimeError(f"time begins at {e.time[0]:g} s; count it from the start of loading")


def _check_mesh(e: Experiment) -> None:
    if not np.isfinite(e.points).all():
        raise errors.DegenerateMeshError("reference points are not finite; drop those points and re-triangulate")
    area = signed_areas(e.points, e.triangles)
    if (area < 0).any():
        raise errors.DegenerateMeshError(
            f"inverted triangles: {_first(area < 0)}; order nodes counter-clockwise (image y-axes point down: flip y)"
        )
    size = np.sqrt(np.median(np.abs(area)))
    flat = area <= 1e-8 * size**2
    if flat.any():
        raise errors.DegenerateMeshError(f"triangles without area: {_first(flat)}; re-triangulate")
    rounded = np.round(e.points / (1e-7 * max(size, 1e-300))).astype(np.int64)
    _, first, count = np.unique(rounded, axis=0, return_index=True, return_counts=True)
    if (count > 1).any():
        raise errors.DegenerateMeshError(
            f"duplicate nodes: {_first(count > 1)}, e.g. node {first[count > 1][0]}; merge nodes at the same place"
        )
    unused = np.setdiff1d(np.arange(len(e.points)), e.triangles)
    if unused.size:
        raise errors.DegenerateMeshError(f"{unused.size} nodes belong to no triangle (first: {unused[0]}); drop them")


def _check_loads(e: Experiment) -> None:
    if not any(np.isfinite(b.force).any() for b in e.loaded):
        raise errors.MissingForceError(
            "no force was measured on any loaded boundary: without one only ratios of stiffness can be found; "
            "give the load-cell record"
        )
    rim = boundary_nodes(e.triangles)
    taken: set[int] = set()
    for b in e.loaded:
        if b.nodes.size < 2:
            raise errors.ExperimentError(f"loaded boundary '{b.name}' has {b.nodes.size} nodes; it needs at least 2")
        if not np.isin(b.nodes, rim).all():
            raise errors.MeshMismatchError(
                f"loaded boundary '{b.name}' contains nodes inside the specimen; list its edge nodes only"
            )
        if taken.intersection(b.nodes.tolist()):
            raise errors.ExperimentError(f"loaded boundary '{b.name}' shares nodes with another; separate them")
        taken.update(b.nodes.tolist())
        if np.isinf(b.force).any():
            raise errors.MissingForceError(f"force of '{b.name}' is infinite; use NaN for what was not measured")
    if not np.isin(e.free_nodes, rim).all():
        raise errors.MeshMismatchError("free_nodes contains nodes inside the specimen; list edge nodes only")
    if taken.intersection(e.free_nodes.tolist()):
        raise errors.ExperimentError("a node is both loaded and free; a gripped node is not free")


def _check_units(e: Experiment) -> None:
    extent = float(np.ptp(e.points, axis=0).max())
    if not 0.5 <= extent <= 5000:
        raise errors.UnitsError(f"the specimen is {extent:.3g} mm long; points must be in mm (0.5 to 5000)")
    moved = float(np.nanmax(np.abs(e.displacements))) if np.isfinite(e.displacements).any() else 0.0
    if moved > 20 * extent:
        raise errors.UnitsError(
            f"displacements reach {moved:.3g} mm on a {extent:.3g} mm specimen; give mm, not pixels"
        )
    if 0 < moved < 1e-6 * extent:
        raise errors.UnitsError(
            f"displacements stay below {moved:.3g} mm on a {extent:.3g} mm specimen; give mm, not m"
        )
    if e.thickness is not None and not 1e-3 <= e.thickness <= extent:
        raise errors.UnitsError(f"thickness {e.thickness:.3g} mm on a {extent:.3g} mm specimen is implausible; give mm")
    force = max(float(np.nanmax(np.abs(b.force), initial=0.0)) for b in e.loaded)
    stress = force / (extent * (e.thickness or 1.0))
    if stress > 1e3 or 0 < stress < 1e-9:
        raise errors.UnitsError(
            f"a force of {force:.3g} N means a nominal stress of about {stress:.2g} MPa; give N (not kN or mN)"
        )


def _check_deformation(e: Experiment) -> None:
    bad = ~np.isfinite(e.displacements).all(axis=(0, 2))
    if bad.any():
        raise errors.InvalidDeformationError(
            f"displacements of {_first(bad)} nodes are not finite; mask failed points with `drop_points`"
        )
    area = signed_areas(e.points, e.triangles)
    for i, u in enumerate(e.displacements):
        jacobian = signed_areas(e.points + u, e.triangles) / area
        if (jacobian <= 0).any():
            raise errors.InvalidDeformationError(
                f"increment {i}: det F <= 0 in triangles {_first(jacobian <= 0)}; mask these points with "
                "`drop_points`, use a coarser triangulation, or drop the increment"
            )
