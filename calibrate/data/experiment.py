"""The Experiment: a measured or simulated surface test, the only thing that joins forward and calibrate.

In: reference points, triangles, displacements, loads (arrays, or one ``.npz``, see `calibrate.data.experiment_file`).
Out: a checked, immutable record; every violation is a named error that says where and what to do.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.data.deformation_shares import deformation_shares
from calibrate.data.experiment_checks import PLANES, check
from calibrate.data.experiment_file import read_fields, write_fields
from calibrate.data.load_record import LoadRecord
from calibrate.data.measurement import LoadedBoundary, Noise
from calibrate.data.strain_signal import StrainSignal, strain_signal
from calibrate.data.triangulation import boundary_nodes

__all__ = ["PLANES", "Experiment", "LoadRecord", "LoadedBoundary", "Noise"]
Array = NDArray[np.float64]
WHOLE = "fingerprint_of_all_pictures"  # in a provenance, of the test that pictures were chosen of
ONE_AXIS = 0.2  # of the largest force: forces across, up to which a sheet is pulled along one axis


@dataclass(frozen=True)
class Experiment:
    """A surface test. Lengths in mm, forces in N, time in s, y upwards.

    points (n_nodes, 2): reference positions. triangles (n_triangles, 3), counter-clockwise.
    displacements (n_increments, n_nodes, 2). loaded: gripped boundaries with their measured forces.
    free_nodes: nodes on truly traction-free edges; other boundary nodes are the rim of the measured region.
    thickness: None = unknown; then stiffness times thickness (N/mm) is identified instead of MPa.
    time (n_increments,), from the start of loading: None = unknown. noise: None = unknown.
    plane: 'stress' of an incompressible sheet with free faces, or 'strain' of a compressible body held at its faces.
    heights (n_increments + 1, n_nodes), mm: of stereo data, distance from the plane fitted to the reference, the reference first;
    None: pictures of one camera.
    record: of the testing machine over the whole test, whichever pictures are kept; None = unknown.
    interpolated (n_increments, k): weights of k pictures in the displacements of the increments, where some are between pictures
    (`calibrate.data.readings_between`); None: each is a picture. No file keeps it.
    continued (k, n_nodes - k): values at the last k points, which are on rims that no camera sees, from those at the others; None: all are measured.

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
    heights: Array | None = None
    record: LoadRecord | None = None
    interpolated: Array | None = None
    continued: sp.csr_array | None = None

    def __post_init__(self) -> None:
        for key in ("points", "displacements"):
            object.__setattr__(self, key, np.ascontiguousarray(getattr(self, key), dtype=np.float64))
        for key in ("triangles", "free_nodes"):
            object.__setattr__(self, key, np.ascontiguousarray(getattr(self, key), dtype=np.int64))
        if self.heights is not None:
            object.__setattr__(self, "heights", np.asarray(self.heights, dtype=np.float64))
        if self.time is not None:
            object.__setattr__(self, "time", np.asarray(self.time, dtype=np.float64))
        loaded = tuple(
            replace(b, nodes=np.asarray(b.nodes, np.int64), force=np.asarray(b.force, np.float64)) for b in self.loaded
        )
        object.__setattr__(self, "loaded", loaded)
        check(self)

    @property
    def n_increments(self) -> int:
        """Number of increments."""
        return self.displacements.shape[0]

    @property
    def n_measured(self) -> int:
        """Number of points that are measured; those after them are continued."""
        return len(self.points) - (0 if self.continued is None else self.continued.shape[0])

    @property
    def given_rims(self) -> NDArray[np.int64]:
        """Nodes (k,) on true edges that the user gave, so that the specimen ends there."""
        fitted = [np.full(rim["points"], rim["fitted"]) for rim in self.provenance.get("rims", ())]
        is_given = ~np.concatenate(fitted) if self.continued is not None and fitted else np.zeros(0, bool)
        return self.n_measured + np.flatnonzero(is_given)

    def as_seen(self, displacements: Array) -> Array:
        """Displacements (n_increments, n_nodes, 2), mm, with those at continued points as the others tell them."""
        if self.continued is None:
            return displacements
        measured = displacements[:, : self.n_measured]
        return np.concatenate([measured, np.stack([self.continued @ u for u in measured])], axis=1)

    @cached_property
    def strain_signal(self) -> StrainSignal:
        """Size of the strain beside its scatter between neighbouring triangles."""
        return strain_signal(self.points, self.triangles, self.displacements)

    @cached_property
    def deformation_shares(self) -> Array:
        """How much of the largest deformation each increment has (n_increments,), see `calibrate.data.deformation_shares`."""
        return deformation_shares(self.points, self.triangles, self.displacements)

    @property
    def most_deformed(self) -> int:
        """The increment of the largest deformation: the last of a ramp, a turning point of a cycle."""
        return int(np.argmax(self.deformation_shares))

    @cached_property
    def pictures(self) -> NDArray[np.int64]:
        """Which increments (k,) are pictures: of those with its displacements the last, when it was taken."""
        if self.interpolated is None:
            return np.arange(self.n_increments)
        n = self.n_increments
        return np.asarray(n - 1 - (self.interpolated[::-1] == 1.0).argmax(axis=0))

    @property
    def clock(self) -> Array:
        """Times (n_increments,), s, or numbers of the increments where they are unknown: what `Noise.correlation_time` counts in."""
        return np.arange(float(self.n_increments)) if self.time is None else self.time

    @property
    def clock_unit(self) -> str:
        """Of `clock`."""
        return "increments" if self.time is None else "s"

    @cached_property
    def has_rim(self) -> bool:
        """Whether part of the boundary is neither loaded nor free: an unknown traction may act there."""
        held = np.concatenate([self.free_nodes, *(b.nodes for b in self.loaded)])
        return not np.isin(boundary_nodes(self.triangles), held).all()

    @property
    def level_is_nominal(self) -> bool:
        """Whether the section carries an unknown part of the forces (a window in a larger body), so that only ratios of stiffness are
        identified: see `calibrate.equations.equilibrium`."""
        return bool(self.provenance.get("rim"))

    @property
    def is_zeroed(self) -> bool:
        """Whether the forces count from that at the reference picture, so that no offset of the load cell is left."""
        return bool(self.provenance.get("zeroed"))

    @property
    def temporal_std(self) -> float:
        """Standard deviation of what changes in the displacements from one picture to the next, as all pictures show it, mm; 0 where it is unknown."""
        found = (self.provenance.get("noise") or {}).get("temporal") or {}
        return float(found.get("std", 0.0))

    @property
    def noise_is_stated(self) -> bool:
        """Whether someone said how large the noise of the displacements is, so that it is not what an import estimated from the fields alone."""
        if self.noise is None or not self.noise.displacement_std > 0:
            return False
        said, kinds = self.provenance.get("noise") or {}, ("total", "temporal")
        estimates = [(said.get(kind) or {}).get("std") for kind in kinds]
        return said.get("displacement") not in kinds or self.noise.displacement_std not in estimates

    @property
    def is_synchronised(self) -> bool:
        """Whether the crosshead's record shows that pictures and forces have one clock, so that there is no lag."""
        return bool((self.provenance.get("clocks") or {}).get("agree"))

    @property
    def largest_forces(self) -> Array:
        """Of all grips along each axis (2,), N; 0 where none was measured."""
        return np.asarray(np.max([np.abs(np.nan_to_num(b.force)).max(axis=0) for b in self.loaded], axis=0))

    @property
    def is_biaxial(self) -> bool:
        """Whether grips pull along both axes: the largest force along one is more than `ONE_AXIS` of that along the other."""
        return bool(self.largest_forces.min() > ONE_AXIS * self.largest_forces.max())

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
        if len(forces) < 2 or not np.isfinite(forces).all() or self.has_rim:
            return None
        size = float(np.linalg.norm(np.linalg.norm(forces, axis=2).max(axis=0)))
        noise = self.noise or Noise(0.0)
        spread = float(np.linalg.norm(noise.force_deviation(forces)))
        return (float(np.linalg.norm(forces.sum(axis=0))) / size, spread / size) if size > 0 else None

    def select(self, increments: NDArray[np.int64] | list[int], name: str | None = None) -> Experiment:
        """The same experiment with only the given increments (k,), counted from 0, as pictures; the machine record stays whole.

        Without time the increments that are left are counted anew, and a correlation time with them: exactly where they are evenly spread.
        """
        index = np.asarray(increments)
        noise = self.noise
        if noise is not None and noise.pattern_std > 0:  # stated at the largest deformation of those that are left
            noise = replace(noise, pattern_std=noise.pattern_std * float(self.deformation_shares[index].max()))
        if noise is not None and self.time is None:
            noise = noise.counted_in(index)
        return replace(
            self,
            name=name or self.name,
            displacements=self.displacements[index],
            time=None if self.time is None else self.time[index],
            heights=None if self.heights is None else self.heights[np.concatenate([[0], index + 1])],
            noise=noise,
            loaded=tuple(replace(b, force=b.force[index]) for b in self.loaded),
            interpolated=None,
        )

    def without_time(self) -> Experiment:
        """The same experiment without times, and so without a machine record; a correlation time of the noise is in mean increments then."""
        noise = self.noise if self.noise is None or self.time is None else self.noise.counted_in(self.time)
        return replace(self, time=None, record=None, noise=noise)

    @property
    def fingerprint(self) -> str:
        """Hash of what was measured, by which a test is recognised whatever its file is called."""
        digest = hashlib.sha256()
        seen = self.pictures
        for array in (self.points, self.displacements[seen], *(b.force[seen] for b in self.loaded)):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()[:16]

    @property
    def whole(self) -> str:
        """Fingerprint of the test with all its pictures, some of which are chosen here."""
        return str(self.provenance.get(WHOLE, self.fingerprint))

    def is_of(self, fingerprint: str) -> bool:
        """Whether this is the test with a fingerprint, or some of its pictures."""
        return fingerprint in (self.fingerprint, self.whole)

    def save(self, path: str | Path) -> None:
        """Write the documented ``.npz`` atomically."""
        write_fields(path, {item.name: getattr(self, item.name) for item in fields(self)})

    @classmethod
    def load(cls, path: str | Path) -> Experiment:
        """Read a ``.npz`` written by `save`.

        Raises `DataNotFoundError` when there is none, `FileFormatError` when it is no such file, `ExperimentError`
        or `ConfigError` when its content fails a check.
        """
        return read_fields(path, cls)
