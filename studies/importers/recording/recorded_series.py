"""What an importer reads of a test: points, triangles, displacements of every frame, the machine's force record, what is gripped.

Time of frame k on the clock of the machine: k / frame rate + offset; that of an Experiment counts from where the test begins. The force is that of the grip ON the
specimen, along `direction` for each loaded boundary.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshes.shapes import Rim
from studies.importers.recording.static_frames import static_count
from studies.importers.recording.synchronise import ForceRecord

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Grip:
    """A loaded boundary: nodes (k,), and the direction (2,) in which a tensile force pulls on it; 0 there means the
    component was not measured. record: of a load cell of its own. slides: held along the direction only, free of traction
    across it."""

    name: str
    nodes: Index
    direction: tuple[float, float]
    record: ForceRecord | None = None
    slides: bool = False

    @property
    def held(self) -> tuple[bool, bool]:
        """Components of the displacement that are prescribed."""
        x, y = self.direction
        return (x != 0, y != 0) if self.slides else (True, True)

    def force(self, force: Array) -> Array:
        """(t, 2) N of a force (t,) N that is positive in tension; NaN for what was not measured."""
        unknown = np.zeros(force.shape) if self.slides else np.full(force.shape, np.nan)
        return np.stack([unknown if d == 0 else d * force for d in self.direction], axis=1)


@dataclass(frozen=True)
class Series:
    """Every frame of a test. points (n, 2) mm, y up; triangles (m, 3); displacements (n_frames, n, 2) mm, NaN where
    a point failed; time (n_frames,) s on the clock of the machine; resolution (s) of that synchronisation. has_clock: False
    where times only number the frames. force_std: of the forces, N, where it is known; None: estimated from the record.
    heights (n_frames, n) mm: of stereo data, distance from the plane of the reference; None: one camera. masked (k, 2) mm: points left out before; tested: whether spurious points were looked for; lone: how many of these have failed in all
    frames here, so that the gap is closed.
    rims: true edges that the points do not reach, mm; fits_holes: whether those of other holes are fitted to the points around them (`calibrate.data.continued_rims`)."""

    name: str
    points: Array
    triangles: Index
    displacements: Array
    time: Array
    record: ForceRecord
    grips: tuple[Grip, ...]
    free_nodes: Index
    thickness: float | None = None
    synchronisation_std: float = 0.0
    plane: str = "stress"
    has_clock: bool = True
    force_std: float | None = None
    provenance: dict[str, Any] = field(default_factory=dict)
    masked: Array = field(default_factory=lambda: np.zeros((0, 2)))
    tested: bool = False
    lone: int = 0
    heights: Array | None = None
    rims: tuple[Rim, ...] = ()
    fits_holes: bool = False

    def start(self, first: int) -> float:
        """When the test begins, s on the clock of the machine: at the last static frame before the first increment, else at the reference."""
        return float(self.time[min(static_count(self.points, self.displacements), first - 1)])
