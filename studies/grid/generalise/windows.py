"""The specimens of the study and what a camera sees of them: a region of interest that ends before grips and free sides.

In: a specimen's name and a margin, mm. Out: the specimen, the seen part of it as a specimen of the same kind, its Experiment. What
ends beside a free side is the rim of the measured region, no free edge: its traction is unknown, and a strip of the width of the margin
beside it carries load (`calibrate.equations.unseen_strip`). The resultant of a grip passes through the section where the region ends
before it. The camera is taken to see holes up to their rims.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.data.triangulation import boundary_nodes
from meshes import Cross, Mesh, Specimen, triangles
from meshes.known_specimens import SPECIMENS
from studies.grid.axes import EXTENT
from studies.grid.generalise.generalise_settings import CROSS
from studies.synthetic import camera

SCALE = 30.0 / 80.0  # of the cross, so that its arms are as wide as the sheets


def specimen(name: str) -> Specimen:
    """A sheet, or the cross with arms 30 mm wide. The cross keeps its shape."""
    if name != CROSS:
        return SPECIMENS[name]()
    return Cross(**{key: SCALE * value for key, value in Cross().dimensions().items()})


def pull(name: str) -> float:
    """Displacement of each grip, mm."""
    return EXTENT[name] * (SCALE if name == CROSS else 1.0)


def seen(shape: Specimen, margin: float) -> Specimen:
    """What is left of a specimen `margin` mm from grips and free sides; its holes stay. Raises `SpecimenError` where these do not fit."""
    smaller: dict[str, Any] = {key: shape.dimensions()[key] - margin for key in ("half_length", "half_width")}
    if isinstance(shape, Cross):
        smaller["fillet_radius"] = shape.fillet_radius + margin
    return replace(shape, **smaller)


def camera_mesh(name: str, margin: float, nodes: int) -> Mesh:
    """Points of the camera on the seen part of a specimen."""
    return triangles(seen(specimen(name), margin), n_nodes=nodes)


def hole_nodes(mesh: Mesh) -> NDArray[np.int64]:
    """Nodes on the rims of the holes, which alone are free."""
    rims = [mesh.boundary_nodes(name) for name in mesh.boundaries if name.startswith("hole_")]
    return np.unique(np.concatenate(rims)) if rims else np.zeros(0, np.int64)


def observe(solution: camera.Solution, mesh: Mesh, name: str, provenance: dict[str, Any]) -> Experiment:
    """What the camera sees without noise of a solution of the whole specimen; forces are those of the grips."""
    whole = camera.observe(solution, mesh, name=name, provenance=provenance)
    return replace(whole, free_nodes=hole_nodes(mesh))


def as_if_whole(experiment: Experiment) -> Experiment:
    """The region of interest taken for the specimen, as the paper does: its rim is free, its width that of the section."""
    held = np.concatenate([b.nodes for b in experiment.loaded])
    edge = np.setdiff1d(boundary_nodes(experiment.triangles), held)
    return replace(experiment, free_nodes=edge)
