"""What a camera, its correlation and a load cell get wrong: an exact solution in, the Experiment so observed out.

A camera sees the point x at V_t(x). Its correlation follows a seen point of the reference picture, so that the
reference points are V_0(X), with X the nodes of the camera's mesh on the specimen, and the measured displacements

    u = V_t(X + mean of U) - V_0(W(X)),

where the mean is over a subset, if there is one, and W is where the specimen was before it was flat. Noise is added afterwards (`studies.synthetic.camera`). Each disturbance is one
small class with its amplitude; several act one after the other. `label` names it as the catalogue of effects does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from forward.solution import SurfaceSolution
from meshes import Mesh, Specimen
from studies.errors import OptionError
from studies.synthetic.camera import boundaries

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Share:
    """How much of the loading and of the time has passed, each 0 to 1, as (t, 1, 1)."""

    loading: Any = 0.0
    time: Any = 0.0


@dataclass(frozen=True)
class Disturbance:
    """Base: an exact camera and load cell. Raises `OptionError` for amplitudes that are no finite numbers."""

    name: ClassVar[str]

    def __post_init__(self) -> None:
        for key, value in asdict(self).items():
            if not np.isfinite(value):
                raise OptionError(f"{self.name}: {key} = {value}; give a finite number")

    def points(self, mesh: Mesh) -> Array:
        """Where on the specimen the nodes of the camera's mesh are, (n, 2), mm."""
        return mesh.points

    def displacements(self, solution: SurfaceSolution, specimen: Specimen, X: Array) -> Array | None:
        """Displacements (t, n, 2), mm, that the correlation finds at X (n, 2), mm; None: those of the points."""
        return None

    def before(self, x: Array) -> Array:
        """Where points x (n, 2), mm, from the middle of the specimen, are seen, (n, 2), mm, before it is loaded."""
        return x

    def see(self, x: Array, share: Share, size: float) -> Array:
        """Where points x (..., 2), mm, from the middle of the picture, are seen, (..., 2), mm. size: largest extent of the specimen, mm."""
        return x

    def forces(self, force: Array, time: Array) -> Array:
        """What a load cell reads, (t, 2), N, of the forces (t, 2), N, at times (t,), s."""
        return force

    def label(self) -> dict[str, Any]:
        """Name and amplitudes in the convention of the catalogue."""
        return {"name": self.name, "amplitudes": asdict(self), "shape": {}}


def observe(
    solution: SurfaceSolution,
    specimen: Specimen,
    mesh: Mesh,
    disturbances: Sequence[Disturbance] = (),
    shares: Array | None = None,
    name: str = "synthetic",
) -> Experiment:
    """What is recorded of a solution on the nodes of `mesh` (triangles, whole specimen), before noise.

    shares (t,): of the loading, 1 at the largest, that out-of-plane motion follows; the load factors by default.
    """
    if shares is None:
        factors = np.asarray(solution.description.get("load_factors", solution.time))
        shares = factors / np.abs(factors).max()
    share = Share(*(np.asarray(s)[:, None, None] for s in (shares, solution.time / solution.time[-1])))
    X = mesh.points
    for d in disturbances:
        X = X + d.points(mesh) - mesh.points
    smoothed = [u for d in disturbances if (u := d.displacements(solution, specimen, X)) is not None]
    u = smoothed[-1] if smoothed else solution.evaluate(X)
    middle, size = 0.5 * (X.min(axis=0) + X.max(axis=0)), float(np.ptp(X, axis=0).max())
    before, after = X - middle, X - middle + u
    for d in disturbances:
        before = d.before(before)
    forces = dict(solution.reactions)
    for d in disturbances:
        before, after = d.see(before, Share(), size), d.see(after, share, size)
        forces = {side: d.forces(force, solution.time) for side, force in forces.items()}
    loaded, free = boundaries(mesh, forces)
    return Experiment(
        name=name,
        points=middle + before,
        triangles=mesh.cells,
        displacements=after - before,
        loaded=loaded,
        free_nodes=free,
        thickness=solution.thickness,
        time=solution.time,
        plane=str(solution.description.get("plane", "stress")),
    )
